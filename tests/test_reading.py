"""Files are read whole, within bounds, and refused if they change meanwhile or are no regular files."""

import os
import zipfile

import pytest

from gaussian_trimmer.errors import InputError
from gaussian_trimmer.io.reading import file_bytes, member_bytes, open_archive, reading


def test_files_that_change_while_they_are_read(tmp_path):
    path = tmp_path / "a"
    path.write_bytes(b"12345678")
    with pytest.raises(InputError, match="changed while it was read"), reading(path):
        path.write_bytes(b"1234567")
    with pytest.raises(InputError, match="changed while it was read"), reading(path):
        os.utime(path, (1, 1))
    with pytest.raises(InputError, match="changed while it was read"), reading(path):
        (tmp_path / "b").write_bytes(b"7654321")
        (tmp_path / "b").replace(path)
    with pytest.raises(InputError, match="Cannot read"), reading(path):
        path.unlink()


def test_files_larger_than_any_of_their_kind(tmp_path):
    (tmp_path / "a").write_bytes(bytes(11))
    assert file_bytes(tmp_path / "a", 11) == bytes(11)
    with pytest.raises(InputError, match="11 bytes; at most 10"):
        file_bytes(tmp_path / "a", 10)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes and devices")
def test_pipes_and_devices_are_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", "/dev/zero"):
        with pytest.raises(InputError, match="not a regular file"):
            file_bytes(type(tmp_path)(path))
        with pytest.raises(InputError, match="not a regular file"), reading(type(tmp_path)(path)):
            pytest.fail("it was opened")


def save_archive(path, members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


def test_members_are_asked_for_by_name_and_size(tmp_path):
    path = save_archive(tmp_path / "a.zip", {"a": bytes(100)})
    with open_archive(path, "archive") as archive:
        assert member_bytes(archive, "a", 100, path) == bytes(100)
        with pytest.raises(InputError, match="claims 100 bytes"):
            member_bytes(archive, "a", 99, path)
        with pytest.raises(InputError, match="no member 'b'"):
            member_bytes(archive, "b", 99, path)
