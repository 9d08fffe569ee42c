"""The commands, run in this process as the terminal runs them."""

import json
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import toy
from command_line import SMALL, run

from gaussian_trimmer import __version__, cli, formats
from gaussian_trimmer.commands import command_in, parser_of
from gaussian_trimmer.commands.arguments import config_of
from gaussian_trimmer.io.folders import atomic_folder
from gaussian_trimmer.trimming.clock import LOG
from gaussian_trimmer.trimming.config import TrimConfig, paper_config


def report_of(folder):
    return json.loads((folder / "report.json").read_text())


def object_of(folder):
    """What the report of a trim says of its only object."""
    (entry,) = report_of(folder)["objects"]
    return entry


def trim(*words):
    """What `trim` makes of words."""
    return parser_of("trim").parse(list(map(str, words)))


def test_trim_writes_and_says_everything(ball, tmp_path, capsys):
    folder, scene, truth = ball
    command = ["trim", folder / "scene.ply", folder / "rough.npy", "--up", -1e-5, -1e-5, 1, "--html", *SMALL]
    output = tmp_path / "out"
    assert run(*command, "--output", output) == 0
    assert sorted(path.name for path in output.iterdir()) == [
        "background.ply", "before_after.png", "labels.npz", "manifest.json", "object.ply", "report.html", "report.json",
        "summary.csv", "views",
    ]  # fmt: skip
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out"]
    labels = np.load(output / "labels.npz", allow_pickle=False)
    trimmed = np.zeros(len(scene), np.bool_)
    trimmed[labels["source_index"][: labels["n_object"]]] = True
    rough = np.load(folder / "rough.npy")
    assert toy.jaccard(trimmed, truth) > max(0.9, toy.jaccard(rough, truth))
    printed = capsys.readouterr()
    assert printed.err == ""
    assert "5 of 5 views used, whose masks follow the selection; checked over" in printed.out
    assert str(output) in printed.out
    lines = printed.out.splitlines()  # whole where there is no terminal
    assert lines == [line.rstrip() for line in lines]
    assert [line.partition(":")[0] for line in lines[:2]] == ["object", "background"]
    said = re.search(r"Of (\d+) selected, ([^;(]*)", printed.out)
    assert int(said[1]) == sum(map(int, re.findall(r"\d+", said[2])))
    assert "0.000 0.000 1.000 (given" in printed.out  # no zero is negative
    assert "-0.000" not in (output / "report.html").read_text().split("Up: ")[1][:100]


def test_a_scene_without_the_object_that_is_not_written_is_not_made(ball, tmp_path, monkeypatch):
    folder, *_ = ball
    command = ["trim", folder / "scene.ply", folder / "rough.npy", "--up", "z", *SMALL, "--background", "filled"]
    assert run(*command, "--output", tmp_path / "with") == 0
    monkeypatch.setattr("gaussian_trimmer.trimming.trim.remove", lambda *_, **__: pytest.fail("It was made."))
    assert run(*command, "--output", tmp_path / "without", "--no-write-background") == 0
    assert not (tmp_path / "without" / "background.ply").exists()
    assert report_of(tmp_path / "without")["configuration"]["background"] == "exact"
    ours, theirs = ((tmp_path / name / "object.ply").read_bytes() for name in ("without", "with"))
    assert ours == theirs


def test_json_is_all_that_services_see(ball, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(LOG, "handlers", [])  # what the command sets ends with the test
    monkeypatch.setattr(LOG, "level", LOG.level)
    folder, scene, _ = ball
    command = ["trim", folder / "scene.ply", folder / "rough.npy", "--up", "z", *SMALL, "--json"]
    assert run(*command, "--output", tmp_path / "out", "--log-level", "info") == 0
    printed = capsys.readouterr()
    told = json.loads(printed.out)
    assert told["objects"] == report_of(tmp_path / "out")["objects"] and told["objects"][0]["refused"] is None
    assert told["folder"] == str(tmp_path / "out")
    assert {"object.ply", "manifest.json"} <= set(told["files"])
    assert all((tmp_path / "out" / name).is_file() for name in told["files"])
    assert "INFO stage: render" in printed.err
    np.save(tmp_path / "labels.npy", np.load(folder / "rough.npy").astype(np.uint8))
    several = ["trim", folder / "scene.ply", "--labels", tmp_path / "labels.npy", "--up", "z", *SMALL, "--json"]
    assert run(*several, "--output", tmp_path / "several") == 0
    assert [each["name"] for each in json.loads(capsys.readouterr().out)["objects"]] == ["1"]
    selecting = ["select", folder / "scene.ply", "--add", folder / "rough.npy", "--json"]
    assert run(*selecting, "--output", tmp_path / "a.npy") == 0
    told = json.loads(capsys.readouterr().out)
    assert told["counts"] == {"selected": int(np.load(tmp_path / "a.npy").sum()), "scene": len(scene)}
    assert run(*command, "--output", tmp_path / "out") == 2  # the folder is not empty
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.count("\n") == 1


def test_options_of_all_stages_reach_the_trimmer(ball, tmp_path):
    folder, _, _ = ball
    command = ["trim", folder / "scene.ply", folder / "rough.npy", "--output", tmp_path, *SMALL, "--quiet"]
    command += ["--up", 0, -0.1, 1, "--views", 3, "--preset", "paper"]
    command += ["--set", "split.rule=none", "--set", "evidence.recover=false", "--format", "splat"]
    assert run(*command) == 0
    report, entry = report_of(tmp_path), object_of(tmp_path)
    assert report["configuration"]["split"]["rule"] == "none"
    assert not report["configuration"]["evidence"]["recover"]
    assert len(entry["views"]) == 3 and all(view["judged"] for view in entry["views"])
    assert "paper" in report["command"]
    assert entry["up"]["direction"][1] == pytest.approx(-0.1 / np.hypot(0.1, 1))
    assert entry["counts"]["added"] == report["counts"]["split"] == 0
    assert len(formats.read(tmp_path / "object.splat")) == entry["counts"]["object"]


def test_which_rows_were_fitted_is_said_on_disk(ball, tmp_path):
    folder, scene, _ = ball
    command = ["trim", folder / "scene.ply", folder / "rough.npy", "--up", 0, 0, 1, "--output", tmp_path, "--quiet"]
    assert run(*command, "--set", "plan.size=160", "--set", "refinement.steps=4") == 0
    labels = np.load(tmp_path / "labels.npz", allow_pickle=False)
    mine = formats.read(tmp_path / "object.ply")
    theirs = scene.means[labels["source_index"][: labels["n_object"]]]
    moved = np.flatnonzero((mine.means != theirs).any(axis=1))
    assert len(moved) and set(moved) <= set(labels["fitted"])
    assert object_of(tmp_path)["counts"]["fitted"] == len(labels["fitted"]) < len(mine)


def test_preset_changes_the_defaults_and_nothing_else():
    paper, default = paper_config(), TrimConfig()
    assert config_of(trim("a.ply", "b.npy")) == default
    assert config_of(trim("a.ply", "b.npy", "--preset", "paper")) == paper
    mixed = config_of(trim("a.ply", "--set", "split.rule=plane", "--preset", "paper", "--set", "plan.fill=0.5"))
    assert (mixed.split.rule, mixed.plan.fill) == ("plane", 0.5)
    assert (mixed.plan.framing, mixed.evidence) == ("paper", paper.evidence)


def test_words_are_made_of_what_they_say():
    """Whatever is typed, in any order, the words of a report say the same, and are read as the same."""
    typed = shlex.split(
        "a.ply --click 3 4 --view 7 --up -y b.npy --scale=2.5 --exclude c.npy d.npy "
        "--set plan.yaw-range-degrees=-90,90 --html --remove-box 1 2 3 4 --grow 1.5 --for=unity"
    )
    words = trim(*typed).parser.words_of(trim(*typed))
    assert words[:3] == ["trim", "a.ply", "b.npy"]
    again = trim(*words[1:])
    assert again.parser.words_of(again) == words
    assert again.in_order == (("click", (3, 4)), ("view", "7"), ("remove_box", (1, 2, 3, 4)), ("grow", 1.5))
    assert (again.up, again.scale, again.exclude) == ((0, -1, 0), 2.5, (Path("c.npy"), Path("d.npy")))
    assert config_of(again).plan.yaw_range_degrees == (-90, 90)


def test_own_masks_take_the_place_of_virtual_views(ball, tmp_path):
    folder, _, _ = ball
    command = ["trim", folder / "scene.ply", folder / "rough.npy", "--output", tmp_path, "--quiet"]
    command += ["--masks", folder / "masks"]
    assert run(*command, "--cameras", folder / "cameras.json") == 0
    report = object_of(tmp_path)
    assert [view["name"] for view in report["views"]] == ["0.png", "1.png", "2.png", "3.png"]
    assert report["up"]["source"] == "camera file"


def test_output_goes_to_a_folder_named_after_the_inputs(ball, tmp_path, monkeypatch, capsys):
    folder, _, _ = ball
    monkeypatch.chdir(tmp_path)
    assert run("trim", folder / "scene.ply", folder / "rough.npy", *SMALL, "--quiet") == 0
    assert capsys.readouterr() == ("", "")
    assert (tmp_path / "trimmed" / f"{folder.name}-rough" / "object.ply").is_file()


def test_trim_spares_its_inputs_and_what_it_did_not_write(ball, tmp_path, capsys, monkeypatch):
    """All is refused before anything is read."""
    folder, _, _ = ball
    with atomic_folder(tmp_path, "trim") as part:
        for name in ("object.ply", "background.ply", "labels.npz"):
            (part / name).write_text("of an earlier run")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    monkeypatch.setattr(formats, "read", lambda path, **_: pytest.fail("it was read"))
    for inputs in (["object.ply"], ["background.ply", folder / "rough.npy"], [folder / "scene.ply", "labels.npz"]):
        assert run("trim", *(tmp_path / name for name in inputs), "--output", tmp_path, "--overwrite") == 2
        assert "is an input of this run" in capsys.readouterr().err
    (tmp_path / "object.ply").write_bytes(b"edited")
    assert run("trim", folder / "scene.ply", folder / "rough.npy", "--output", tmp_path, "--overwrite") == 2
    assert "object.ply' is in the way" in capsys.readouterr().err
    (tmp_path / "object.ply").write_bytes(before[tmp_path / "object.ply"])
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before


def test_lifted_selection_finds_the_object(ball, tmp_path, capsys):
    folder, _, truth = ball
    selection = tmp_path / "lifted.npy"
    command = ["select", folder / "scene.ply", "--masks", folder / "masks", "--cameras", folder / "cameras.json"]
    assert run(*command, "--output", selection) == 0
    assert toy.jaccard(np.load(selection), truth) > 0.5
    assert "4 masks" in capsys.readouterr().out
    assert run(*command, "--output", selection) == 0  # its own file may be replaced
    np.save(selection, truth)
    assert run(*command, "--output", selection) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert run(*command, "--output", tmp_path / "a.txt") == 2


def test_convert_and_info(ball, tmp_path, capsys):
    folder, scene, _ = ball
    target = tmp_path / "ball.spz"
    assert run("convert", folder / "scene.ply", target, "--json") == 0
    made = json.loads(capsys.readouterr().out)
    assert (made["gaussians"], made["file"]) == (len(scene), str(target)) and "precision" in str(made)
    for source, wrong, said in (
        (folder / "scene.ply", [target], "exists"),
        (target, [target, "--overwrite"], "is an input of this run"),
        (target, [tmp_path / "nowhere" / "ball.spz"], "no folder"),
    ):
        assert run("convert", source, *wrong) == 2
        assert said in capsys.readouterr().err
    assert run("convert", folder / "scene.ply", target, "--overwrite", "--sort", "--quiet") == 0
    assert capsys.readouterr().out == ""
    assert len(formats.read(target)) == len(scene)
    assert run("info", target, folder / "rough.npy", folder / "cameras.json", "--json") == 0
    splats, selection, cameras = json.loads(capsys.readouterr().out)["files"]
    assert splats["gaussians"] == len(scene) and splats["sh_degree"] == 0
    assert "bool" in selection["said"] and "gaussians" not in selection and "5 views" in cameras["said"]


@pytest.mark.parametrize("command", [*cli.COMMANDS])
def test_every_command_explains_itself_shortly_and_in_full(command, capsys):
    assert run(*command.split(), "--help") == 0
    short = capsys.readouterr().out
    assert f"usage: gaussian-trimmer {command}" in short and short.count("\n") <= 80
    assert run(*command.split(), "--help-all") == 0
    full = capsys.readouterr().out
    assert set(options_in(short)) <= set(options_in(full))
    assert set(options_in(full)) == set(options_in(short)) or "--help-all" in short
    for example in re.findall(r"^  gaussian-trimmer (.+)$", short, re.MULTILINE):
        name, words = command_in(shlex.split(example))
        parser_of(name).parse(words)
    for text in (short, full):
        said = " ".join(re.sub(r"-\n +", "-", text).split())
        assert not re.search(r"\(default: [^()]*\) \(default:|None|│|typing|<class|--[\w-]*_", said)


def options_in(text):
    """Options that help lists, each by its first spelling."""
    return re.findall(r"^  (--[\w.\[\]-]+)", text, re.MULTILINE)


DATASETS = {f"evaluate {name}": ["a", "--predictions", "p"] for name in ("nvos", "lerf-mask", "lerf-ovs")}
NEEDED = DATASETS | {
    "convert": ["a", "b"],
    "evaluate": ["a", "b", "--masks", "m", "--cameras", "c"],
    "demo": [],
}


@pytest.mark.parametrize("command", [*cli.COMMANDS])
def test_bad_values_are_one_sentence_without_names_of_python(command, capsys):
    run(*command.split(), "--help-all")
    found = re.findall(r"^  (--[\w.-]+) (\S.*)$", capsys.readouterr().out, re.MULTILINE)
    kinds = {re.sub(r"\{.*", "CHOICE", metavar): name for name, metavar in found if name != "--up"}
    for kind, option in kinds.items():  # one option for each kind of value
        if not re.search(r"INT|FLOAT|CHOICE|\bX\b", kind):
            continue
        assert run(*command.split(), *NEEDED.get(command, ["a"]), option, "nonsense") == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1 and said.endswith(".\n") and len(said) < 250
        assert not re.search(r"<class|typing|NoneType|Literal|tuple|\[bold\]|[│╭]", said)
        assert option in said and ("nonsense" in said or "must be" in said)
        assert re.search("must be|available:", said)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["tirm"], "Unknown command 'tirm'; did you mean trim?"),
        (["explode"], "available: trim, batch, demo"),
        (["trim"], "'trim' needs SCENE"),
        (["convert", "a.ply"], "'convert' needs TARGET"),
        (["info", ""], "is ''; it must be a path"),
        (["info"], "'info' needs FILE"),
        (["evaluate", "a.ply", "b.ply"], "'evaluate' needs --masks"),
        (["trim", "a.ply", "--vieus", 3], "--vieus is not an option or argument of 'trim'; did you mean --views?"),
        (["trim", "a.ply", "b.npy", "c"], "c is not an option or argument of 'trim'"),
        (["trim", "a.ply", "-v"], "-v is not an option or argument of 'trim'"),
        (["trim", "a.ply", "--up", "w"], "--up is 'w'"),
        (["trim", "a.ply", "--views"], "--views has no value"),
        (["select", "a.ply", "--click", "360"], "--click must be X Y"),
        (["select", "a.ply", "--click", "360", "1.5"], "--click[1] is '1.5'; it must be a whole number"),
        (["trim", "a.ply", "--vie", 3], "--vie is not an option or argument of 'trim'; did you mean --view?"),
        (["trim", "a.ply", "--up", "z", "--up=x"], "--up is given twice"),
        (["trim", "a.ply", "--html=3"], "--html/--no-html takes no value"),
        (["trim", "a.ply", "b.npy", "--view", 3], "The number of virtual views is --views"),
        (["trim", "a.ply", "--click", 1, 1, "--view", 3, "--view", 4], "A view has no --click or --box after it"),
        (["trim", "a.ply", "--view", 3, "--view", 4, "--click", 1, 1], "A view has no --click or --box after it"),
        (["trim", "a.ply", "b.npy", "--objects", 3], "--objects says which objects of --labels"),
        (["trim", "a.ply", "--plan.size", 96], "write --set plan.size=INT"),
        (["trim", "a.ply", "--gamma", 1], "write --set selection.gamma=FLOAT"),
        (["trim", "a.ply", "--set", "plan.size"], "--set plan.size has no value"),
        (
            ["trim", "a.ply", "--set", "plan.sice=3"],
            "--set plan.sice: there is no such setting; did you mean plan.size?",
        ),
        (["trim", "a.ply", "--set", "plan.size=3"], "plan.size is 3; it must be a whole number from 16 to 8192"),
        (["trim", "a.ply", "--renderer", "numba"], "--renderer is gone. Leave it out"),
        (["trim", "a.ply", "--sphere", 0, 0, 0, 1], "--sphere is gone. Cut by boxes, balls and planes"),
        (["completion", "bash"], "'completion' is gone."),
        (["trim", "rough.npy", "scene.ply"], "the scene comes before the selection"),
        (["trim", "a.ply", "b.npy", "--masks", "m", "--views", 3], "leave --sam and --views out"),
        (["trim", "a.ply", "b.npy", "--masks", "m", "--sam", "model"], "leave --sam and --views out"),
        (["trim", "a.ply", "--labels", "b.npy", "--masks", "m"], "--masks is for one object"),
        (["trim", "a.ply", "--labels", "b.npy", "--add", "c.npy"], "leave SELECTION and marks out"),
    ],
)
def test_wrong_usage_is_one_sentence(arguments, said, capsys):
    assert run(*arguments) == 2
    printed = capsys.readouterr().err
    assert said in printed and printed.count("\n") == 1


@pytest.mark.parametrize(
    ("given", "vector"),
    [
        (["--up", "z"], (0, 0, 1)),
        (["--up", "-y"], (0, -1, 0)),
        (["--up=X"], (1, 0, 0)),
        (["--up", "0", "-1e-2", "-1"], (0, -0.01, -1)),
        (["--up", "0,0,-1"], (0, 0, -1)),
        (["--up", "0", "0", "-1", "0.5"], (0, 0, -1, 0.5)),
    ],
)
def test_up_is_an_axis_wherever_it_stands(given, vector):
    for command in ("trim", "select"):
        assert parser_of(command).parse([*given, "a.ply"]).up == vector
    assert parser_of("convert").parse(["a.ply", *given, "b.ply"]).up == vector


@pytest.mark.parametrize(
    ("words", "options"),
    [
        (["--options", "--html"], "--html"),
        (["--options=--views=7"], "--views=7"),
        (["--options", "--views 7"], "--views 7"),
    ],
)
def test_a_text_of_options_may_be_a_single_one(words, options):
    made = parser_of("batch").parse([*words, "a.csv", "--quiet"])
    assert (made.options, made.manifests[0].name, made.quiet) == (options, "a.csv", True)


def test_a_value_behind_an_equals_sign_may_begin_with_dashes(capsys):
    assert str(trim("a.ply", "--output=--out").output) == "--out"
    assert run("trim", "a.ply", "--output", "--out") == 2
    assert "--out is not an option or argument of 'trim'; did you mean --output?" in capsys.readouterr().err


def test_what_the_terminal_warns_of_stands_in_the_report(ball, tmp_path, capsys):
    """A guessed up vector, of one object and of several: there once, since all have the same."""
    scene, truth = ball[1:]
    object_alone = scene.select(truth)
    formats.write(object_alone, tmp_path / "a.ply")
    np.save(tmp_path / "ids.npy", 1 + (object_alone.means[:, 0] > object_alone.means[:, 0].mean()))
    command = ["trim", tmp_path / "a.ply", "--labels", tmp_path / "ids.npy", "--overwrite", *SMALL]
    for more in ([], ["--objects", 2]):
        assert run(*command, "--output", tmp_path / "out", "--json", *more) == 0
        printed = capsys.readouterr()
        report = json.loads(printed.out)
        assert report_of(tmp_path / "out")["objects"] == report["objects"]
        for entry in report["objects"]:
            (guess,) = (sentence for sentence in entry["warnings"] if "up vector is a guess" in sentence)
        assert printed.err.count(guess) == 1 and f"gaussian-trimmer: {guess}\n" in printed.err


def test_an_earlier_trim_is_kept_out_of_the_next(ball, tmp_path, capsys):
    """What `labels.npz` of an earlier trim gave to its object is not selected again, nor joined."""
    folder, scene, _ = ball
    command = ["trim", folder / "scene.ply", "--up", "z", *SMALL, "--quiet"]
    assert run(*command, folder / "rough.npy", "--output", tmp_path / "a") == 0
    first = np.load(tmp_path / "a" / "labels.npz")
    taken = first["source_index"][: first["n_object"]]
    wider = np.linalg.norm(scene.means - toy.CENTRE, axis=1) < toy.RADIUS + 1
    np.save(tmp_path / "wider.npy", wider)
    exclude = ["--exclude", tmp_path / "a" / "labels.npz"]
    assert run(*command, tmp_path / "wider.npy", *exclude, "--output", tmp_path / "b") in (0, 3)
    second = np.load(tmp_path / "b" / "labels.npz")
    assert not np.isin(second["source_index"][: second["n_object"]], taken).any()
    assert object_of(tmp_path / "b")["counts"]["selected"] == np.count_nonzero(wider) - wider[taken].sum()
    np.save(tmp_path / "inside.npy", np.isin(np.arange(len(scene)), taken[:99]))
    assert run(*command, tmp_path / "inside.npy", *exclude, "--output", tmp_path / "d") == 2
    assert "Nothing is left of the selection" in capsys.readouterr().err


def test_a_reader_that_has_seen_enough_is_no_error():
    code = "import sys; from gaussian_trimmer.cli import main; sys.exit(main(['evaluate', '--help-all']))"
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run([sys.executable, "-c", code], stdout=writer, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writer)
    assert (done.returncode, done.stderr) == (141, "")


def test_overview_names_every_command_and_the_version(capsys):
    assert run() == run("--help") == 0
    printed = capsys.readouterr().out
    assert all(f"\n  {command} " in printed for command in cli.COMMANDS)
    assert run("--version") == 0
    assert capsys.readouterr().out == f"gaussian-trimmer {__version__}\n"


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (KeyboardInterrupt(), 130, ""),
        (OSError(28, "No space left on device", "/disk/object.ply"), 2, "No space left on device: '/disk/object.ply'"),
        (MemoryError(), 2, "not enough memory"),
        (RuntimeError("can't start new thread"), 2, "not enough memory for another thread"),
    ],
)
def test_what_stops_a_run_ends_in_a_code_and_a_sentence(error, code, said, monkeypatch, ball, tmp_path, capsys):
    folder, _, _ = ball

    def stop(*_, **__):
        raise error

    monkeypatch.setattr(formats, "read", stop)
    assert run("trim", folder / "scene.ply", folder / "rough.npy", "--output", tmp_path / "out") == code
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_defects_keep_their_traceback(monkeypatch, ball):
    folder, _, _ = ball
    monkeypatch.setattr(formats, "read", lambda path, **_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        run("trim", folder / "scene.ply", folder / "rough.npy", "--output", folder / "out")


def test_module_runs_and_the_overview_loads_nothing_heavy():
    code = "import sys; from gaussian_trimmer.cli import main; main(['--help']); print(sorted(sys.modules))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert "'gaussian_trimmer.cli'" in loaded
    for module in ("numpy", "numba", "torch", "rich"):
        assert f"'{module}'" not in loaded
    run_as_module = [sys.executable, "-m", "gaussian_trimmer", "--version"]
    assert subprocess.run(run_as_module, capture_output=True, text=True, check=True).stdout.endswith(f"{__version__}\n")


def test_warnings_of_libraries_stay_off_the_terminal(ball):
    folder, _, _ = ball
    code = (
        "import sys, warnings; from gaussian_trimmer import cli, formats; read = formats.read\n"
        "def read_and_warn(path, **options): warnings.warn('heard'); return read(path, **options)\n"
        f"formats.read = read_and_warn; sys.exit(cli.main(['info', {str(folder / 'scene.ply')!r}]))"
    )
    for options, heard in (([], False), (["-W", "default"], True)):
        done = subprocess.run([sys.executable, *options, "-c", code], capture_output=True, text=True, check=True)
        assert "splats:" in done.stdout
        assert ("heard" in done.stderr) == heard
