from __future__ import annotations

import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.main import get_command

from control.parts import PART_KINDS
from scenes import models
from scenes.commands import app as app_module
from scenes.commands import cli
from scenes.language.errors import SceneError
from scenes.language.loader import shipped_scenes
from scenes.models.loading import parse_scene
from scenes.records.store import save

SHORT = ("-o", "run.duration_s=0.2", "-o", "gait.period_s=0.2")


@pytest.fixture
def result(record, tmp_path: Path) -> Path:
    save(record, tmp_path / "result.nc")
    return tmp_path


def modules_after(*arguments: str) -> set[str]:
    code = (
        "import sys; from scenes.commands.cli import main\n"
        "try: main(sys.argv[1:])\n"
        "except SystemExit as end: assert not end.code, end.code\n"
        "print('MODULES', *sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


SLOW = {
    *("IPython", "matplotlib", "meshcat", "pandas", "rich", "tornado", "trimesh", "zmq"),
    *(f"scipy.{part}" for part in ("interpolate", "linalg", "ndimage", "optimize", "spatial", "special", "stats")),
}
"""Modules that take a tenth of a second or more to import, each."""


def test_commands_import_nothing_that_they_do_not_need() -> None:
    assert not modules_after("--help") & {*SLOW, "casadi", "h5py", "numba", "numpy", "pydantic"}
    assert not modules_after("check", "planar_published") & {*SLOW - {"scipy.linalg"}, "casadi", "h5py", "numba"}
    assert not modules_after("check", "flat") & {*SLOW, "h5py"}


@pytest.mark.parametrize("scene", ["flat", "planar_case"])
def test_a_run_draws_and_writes_its_page_without_slow_imports(tmp_path: Path, scene: str) -> None:
    """They took more than ten times as long as the run."""
    assert not modules_after("run", scene, *SHORT, "--quiet", "--out", str(tmp_path / "x")) & SLOW
    assert {path.name for path in (tmp_path / "x").iterdir()} >= {"overview.png", "viewer.html"}


def test_version(worm3d) -> None:
    assert worm3d("--version").out == "worm3d 0.1.0\n"


@pytest.mark.parametrize("kind", PART_KINDS)
def test_list_names_the_parts_of_a_kind_and_the_keys_that_take_them(worm3d, kind: str) -> None:
    lines = worm3d("list", kind).out.splitlines()
    keys, parts = [line for line in lines if line[0] != " "], [line.split()[0] for line in lines if line[0] == " "]
    assert keys
    assert all("module:NAME" in line and ", in scenes of worm" in line for line in keys)
    shipped = {*PART_KINDS[kind].registry} if kind != "measure" else set()  # summaries have all that ship
    assert shipped - {"none"} <= {*parts}


def test_list_of_an_unknown_kind_says_what_was_meant(worm3d) -> None:
    ended = worm3d("list", "gaits")
    assert (ended.code, ended.complaints) == (2, ["unknown kind of parts; did you mean 'gait'?"])


def test_list_names_each_scene_and_what_to_see(worm3d) -> None:
    lines = worm3d("list").out.splitlines()
    assert [line.split()[0] for line in lines] == list(shipped_scenes())
    assert all(len(line.split()) > 3 for line in lines)


def test_check_of_a_right_scene(worm3d) -> None:
    ended = worm3d("check", "planar_published")
    assert (ended.code, ended.out) == (0, "planar_published: the scene is right (model planar_published, 1000 steps)\n")


def test_mistakes_are_lines_and_no_traceback(console, tmp_path: Path) -> None:
    (tmp_path / "bad.toml").write_text('model = "planar_published"\n[gait]\nlamda_m = 1.0\nperiod_s = "2 s"\n')
    for command in (("check",), ("run", "--out", "x")):
        ended = console(*command, "bad.toml", "-o", "worm.segments=0")
        assert (ended.code, ended.out) == (2, "")
        assert ended.complaints == [
            "line 3: gait.lamda_m: unknown key; did you mean 'wavelength_m'?",
            "line 4: gait.period_s: got '2 s': input should be a valid number [s], 0 < … "
            "(default that of its kind: 2 for travelling_wave, larva_ei, 6 others; 6 for two_anchor, inchworm, "
            "discrete, extension_wave; 5 for planned_turn; 1.25 for steered)",
            "override worm.segments: got 0: input should be greater than or equal to 1, 1 <= … <= 200 (default 6)",
        ]
    assert not (tmp_path / "x").exists()


def test_broken_toml_has_a_caret(console, tmp_path: Path) -> None:
    (tmp_path / "broken.toml").write_text("[run\n")
    ended = console("check", "broken.toml")
    assert ended.code == 2
    assert ended.complaints[1:] == ["    [run", "        ^"]


@pytest.mark.parametrize(
    "arguments", [(), ("run",), ("fly",), ("run", "planar_published", "--bogus"), ("run", "--duration", "long")]
)
def test_usage_errors_are_2(worm3d, arguments: tuple[str, ...]) -> None:
    ended = worm3d(*arguments)
    assert ended.code == 2
    assert "Usage: " in ended.out + ended.err


def test_the_duration_of_a_run_is_a_key(worm3d) -> None:
    ended = worm3d("run", "planar_published", "--duration", "5")
    assert ended.code == 2
    assert ended.complaints == ["run: --duration is a key of the scene, run.duration_s: -o run.duration_s=5"]


def test_init_writes_a_scene_that_is_right_and_complete(worm3d, tmp_path: Path) -> None:
    assert worm3d("init", "mine.toml").code == 0
    assert worm3d("check", "mine.toml").code == 0
    text = (tmp_path / "mine.toml").read_text()
    settings = parse_scene(text, "mine").settings
    plain = parse_scene(f'model = "worm"\ntitle = "{settings.title}"\nsays = "{settings.says}"', "plain")
    assert settings == plain.settings
    assert "\n# time step [s], 0 < …\ndt_s = 0.01\n" in text
    unwrapped = text.replace("\n# ", " ")
    assert '; one of "direct", "retrograde", "standing" direction is left out: that of its kind: ' in unwrapped
    assert max(len(line) for line in text.splitlines() if line.startswith("# ")) <= 120
    keys = [line for line in text.splitlines() if " = " in line and not line.startswith("#")]
    written = [line for line in parse_scene(text, "mine").to_toml().splitlines() if " = " in line]
    own = re.findall(r"^# (\w+) is left out: that of its kind", text, re.MULTILINE)
    assert sorted(keys) == sorted(line for line in written if line.partition(" = ")[0] not in own)
    swept = text.replace("# [sweep]", "[sweep]").replace("# vary = ", "vary = ")
    assert parse_scene(swept, "mine").sweep == {"vary": {"seed": [1, 2, 3]}}


@pytest.mark.parametrize("model", models.names())
def test_the_template_of_each_model_is_right_and_all_defaults(worm3d, tmp_path: Path, model: str) -> None:
    assert worm3d("init", "mine.toml", "--model", model).code == 0
    assert worm3d("check", "mine.toml").code == 0
    settings = parse_scene((tmp_path / "mine.toml").read_text(), "mine").settings
    plain = parse_scene(f'model = "{model}"\ntitle = "{settings.title}"\nsays = "{settings.says}"', "plain")
    assert settings == plain.settings


def test_init_does_not_overwrite(worm3d, tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("precious")
    ended = worm3d("init", "mine.toml")
    assert (ended.code, ended.complaints) == (
        2,
        ["mine.toml exists: choose another name, or replace it with --force"],
    )
    assert (tmp_path / "mine.toml").read_text() == "precious"
    assert worm3d("init", "mine.toml", "--force").code == 0


def test_init_of_an_unknown_model_and_into_nowhere(worm3d) -> None:
    ended = worm3d("init", "mine.toml", "--model", "zzz")
    assert (ended.code, ended.complaints) == (
        2,
        [
            "--model: got 'zzz', must be one of worm, worm_control, load_frame, worm_planar, planar_published, "
            "planar_linkage"
        ],
    )
    ended = worm3d("init", "none/mine.toml")
    assert (ended.code, ended.complaints) == (1, ["cannot write none/mine.toml: no such file or directory"])


def test_plot_draws_into_the_results_folder_or_another(worm3d, result: Path) -> None:
    assert worm3d("plot", result).code == 0
    drawn = {path.name for path in result.glob("*.png")}
    assert drawn == {"overview.png", *(f"{stem}.png" for stem in models.get("planar_published").figures)}
    assert worm3d("plot", result / "result.nc", "--out", "other").code == 0
    ended = worm3d("plot", result, "--out", result / "result.nc")
    assert (ended.code, ended.complaints) == (2, [f"{result / 'result.nc'} is a file: choose a folder for --out"])
    assert {path.name for path in (result / "other").iterdir()} == drawn


def test_animate(worm3d, result: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert worm3d("animate", result, "--fps", 10).out == f"{result}/animation.gif\n"
    monkeypatch.setenv("PATH", "")
    ended = worm3d("animate", result, "--out", "x.mp4")
    assert ended.code == 4
    assert len(ended.complaints) == 1
    assert "ffmpeg" in ended.complaints[0]
    assert worm3d("animate", result, "--out", "x.avi").code == 2
    assert worm3d("animate", result).complaints == [
        f"{result}/animation.gif exists: choose another name, or replace it with --force"
    ]
    assert worm3d("animate", result, "--force").code == 0


def test_a_film_is_an_export(worm3d, result: Path) -> None:
    assert worm3d("export", result, "--film", "run.gif", "--fps", 10).out == "run.gif\n"
    assert worm3d("animate", result, "--out", "same.gif", "--fps", 10).code == 0
    assert (result / "run.gif").read_bytes() == (result / "same.gif").read_bytes()
    ended = worm3d("export", result, "--film", "run.gif")
    assert ended.complaints == ["run.gif exists: choose another name, or replace it with --force"]


def test_the_help_names_all_commands_once_on_a_screen_and_former_names_still_work(worm3d) -> None:
    lines = worm3d("--help").out.splitlines()
    named = [line.split()[0] for line in lines if line.startswith("  ") and line[2] not in "- S"]
    listed = {name: command for name, command in get_command(app_module.app).commands.items() if not command.hidden}
    assert sorted(named) == sorted(listed)
    assert len(lines) <= 33
    for former in (("bench", "control"), ("gait", "fit"), ("paper",), ("validate",), ("technologies",), ("identify",)):
        study = {"bench": "control", "gait": "gait"}.get(former[0], former[0])
        told, now = (worm3d(*words, "--help").out.partition("\n")[2] for words in (former, ("study", study)))
        assert told == now != ""


@pytest.mark.parametrize("more", [("flat",), ("-o", "run.dt_s=0.1"), ("--accuracy", "0.1")])
def test_a_run_that_goes_on_takes_no_scene_and_no_changes(worm3d, result: Path, more: tuple[str, ...]) -> None:
    ended = worm3d("run", "--resume", result, *more)
    assert ended.complaints == ["run: --resume continues a run without changes; leave out SCENE, -o and --accuracy"]


def test_frames_per_second_and_capital_endings(worm3d, result: Path) -> None:
    frames = {}
    for fps in (5, 20):
        assert worm3d("animate", result, "--fps", fps, "--out", f"{fps}.GIF").code == 0
        with Image.open(result / f"{fps}.GIF") as movie:
            frames[fps] = movie.n_frames
    assert frames == {5: 2, 20: 5}  # 0.2 s, both ends


def test_an_export_spares_the_result_and_its_other_half(worm3d, result: Path) -> None:
    before = (result / "result.nc").read_bytes()
    ended = worm3d("export", result, "--npz", "result.nc", "--force")
    assert (ended.code, ended.complaints) == (2, ["result.nc is the result itself: choose another name"])
    (result / "run.gif").write_bytes(before)
    assert worm3d("animate", "run.gif", "--out", "run.gif", "--force").code == 2
    assert (result / "run.gif").read_bytes() == (result / "result.nc").read_bytes() == before
    ended = worm3d("export", result, "--npz", "same", "--csv", "./same", "--force")
    assert (ended.code, ended.complaints) == (2, ["same is named twice: choose two names"])
    assert not (result / "same").exists()


@pytest.mark.parametrize("command", ["run", "plot", "animate", "paper"])
def test_an_empty_name_is_not_this_folder(worm3d, result: Path, command: str) -> None:
    argument = {"run": ("planar_published",), "paper": ()}.get(command, (result,))
    before = {path.name for path in result.iterdir()}
    ended = worm3d(command, *argument, "--out", "")
    assert ended.code == 2
    assert "got an empty name: must name a file or folder" in ended.err
    assert {path.name for path in result.iterdir()} == before


def test_ctrl_c_while_starting_is_130_and_no_traceback(tmp_path: Path) -> None:
    code = (
        "import sys\n"
        "class Slow:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name == 'typer': raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Slow())\n"
        "from scenes.commands.cli import main; main(['list'])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "")


def test_export(worm3d, result: Path, record) -> None:
    assert worm3d("export", result, "--csv", "x.csv", "--npz", "x.npz").out == "x.csv\nx.npz\n"
    assert len((result / "x.csv").read_text().splitlines()) == record.sizes["time"] + 1
    with np.load(result / "x.npz") as arrays:
        np.testing.assert_array_equal(arrays["com"], record["com"])
    ended = worm3d("export", result, "--csv", "x.csv")
    assert (ended.code, ended.complaints) == (
        2,
        ["x.csv exists: choose another name, or replace it with --force"],
    )
    assert worm3d("export", result, "--csv", "x.csv", "--force").code == 0
    ended = worm3d("export", result)
    assert (ended.code, ended.complaints) == (
        2,
        ["export: nothing to write; give --csv FILE, --npz FILE, --glb FILE or --film FILE"],
    )
    assert worm3d("export", result, "--csv", "none/x.csv").code == 1


@pytest.mark.parametrize("command", ["plot", "animate", "export"])
def test_results_that_are_none(worm3d, tmp_path: Path, command: str) -> None:
    (tmp_path / "result.nc").write_text("hello")
    ended = worm3d(command, tmp_path, *(("--csv", "x.csv") if command == "export" else ()))
    assert ended.code == 2
    assert ended.complaints[0].startswith(f"{tmp_path}/result.nc: not a result of worm3d, or cut short: ")


def test_a_result_of_a_model_we_do_not_know(worm3d, record, tmp_path: Path) -> None:
    from dataclasses import replace

    save(replace(record, model="octopus"), tmp_path / "result.nc")
    assert worm3d("plot", tmp_path).complaints == [
        "planar_published: made by the model 'octopus', this worm3d knows only worm, worm_control, load_frame, "
        "worm_planar, planar_published, planar_linkage"
    ]


def test_paper_passes_its_options_on_and_its_exit_code_back(worm3d, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[object] = []

    def study(*options: object) -> int:
        asked.extend(options)
        return 3

    monkeypatch.setattr("scenes.studies.paper.report.run", study)
    assert worm3d("paper", "--out", "x", "--force", "--quiet").code == 3
    assert asked == [Path("x"), True, True]


def test_info_says_what_is_installed_and_where(worm3d) -> None:
    lines = worm3d("info").out.splitlines()
    assert lines[0] == "worm3d 0.1.0"
    assert f"package scenes at {Path(cli.__file__).parents[1] / '__init__.py'}" in lines
    assert any("numpy " + np.__version__ in line for line in lines)
    assert len(lines) < 12


def test_ctrl_c_outside_a_run_is_130(worm3d, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("scenes.running.packages.info_lines", interrupted)
    ended = worm3d("info")
    assert ended.code == 130
    assert "Traceback" not in ended.err


def test_it_runs_as_a_module_too(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "scenes.commands.cli", "list"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "flat  The default worm crawls" in done.stdout


@pytest.mark.parametrize("made", [RuntimeError("KeyboardInterrupt"), SystemError("error set"), SceneError("no")])
def test_ctrl_c_that_a_library_makes_another_error_of_ends_without_a_traceback(
    made: Exception, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """CasADi looks for signals while it computes, and raises errors of its own kinds where there was one."""

    def command(args: object) -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise made from None

    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    monkeypatch.setattr(app_module, "app", command)
    try:
        with pytest.raises(SystemExit) as ended:
            cli.main([])
    finally:
        signal.signal(signal.SIGINT, before)
    assert ended.value.code == 130
    assert capsys.readouterr().err == ""


def test_an_error_without_ctrl_c_remains_what_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    def command(args: object) -> None:
        raise RuntimeError("ours")

    before = signal.getsignal(signal.SIGINT)
    monkeypatch.setattr(app_module, "app", command)
    with pytest.raises(RuntimeError, match="ours"):
        cli.main([])
    assert signal.getsignal(signal.SIGINT) is before
