"""Results appear whole or not at all: single files, and folders of results that replace earlier ones."""

from gaussian_trimmer.io.atomic.files import atomic_file, write_array
from gaussian_trimmer.io.atomic.folders import atomic_folder

__all__ = ["atomic_file", "atomic_folder", "write_array"]
