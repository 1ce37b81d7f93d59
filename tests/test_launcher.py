"""./limen: what is missing, the stamp, the lock, the driver's variables, and an interrupted set-up."""

from __future__ import annotations

import ast
import dataclasses
import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from support.processes import PYTHON, started

ROOT = Path(__file__).resolve().parents[1]
TOOLS = ROOT / "tools"


@pytest.fixture(scope="module", autouse=True)
def tools_on_path() -> Iterator[None]:
    """As ./limen has it; only these tests see it."""
    sys.path.insert(0, str(TOOLS))
    yield
    sys.path.remove(str(TOOLS))


def module(name: str) -> ModuleType:
    return importlib.import_module(f"launcher.{name}")


@pytest.fixture
def checkout(tmp_path: Path) -> Any:
    """A checkout with a space in its path, and a .venv that is there as far as the stamp can tell."""
    root = tmp_path / "a checkout"
    (root / ".limen").mkdir(parents=True)
    (root / "pyproject.toml").write_text("[project]\nname = 'limen'\n[dependency-groups]\ntest = ['pytest>=8']\n")
    made = module("state").Checkout(root)
    made.python.parent.mkdir(parents=True)
    made.python.symlink_to(sys.executable)
    (made.venv / "pyvenv.cfg").write_text("home = x\n")
    return made


# What is missing


def steps_for(
    need: dict[str, bool], stamp: dict[str, object], environment: str = "E", driver: str = "D"
) -> tuple[str, ...]:
    state = module("state")
    return state.missing(state.Stamp(**stamp), state.Need(**need), environment, driver)


@pytest.mark.parametrize(
    ("need", "stamp", "expected"),
    [
        ({}, {}, ("environment",)),
        ({}, {"environment": "E"}, ()),
        ({}, {"environment": "old"}, ("environment",)),
        ({}, {"environment": "old", "test": True}, ("environment", "test")),
        ({"driver": True}, {}, ("environment", "driver")),
        ({"driver": True}, {"environment": "E"}, ("driver",)),
        ({"driver": True}, {"environment": "E", "driver": "D"}, ()),
        ({"driver": True}, {"environment": "E", "driver": "other"}, ("driver",)),
        ({"driver": True}, {"environment": "old", "driver": "D"}, ("environment", "driver")),
        ({"test": True}, {"environment": "E"}, ("test",)),
        ({"observer": True, "driver": True}, {}, ("environment", "observer", "driver")),
        ({"observer": True}, {"environment": "E", "observer": True}, ()),
        ({"test": True, "observer": True}, {"environment": "E", "test": True}, ("observer",)),
        ({}, {"environment": "old", "observer": True}, ("environment", "observer")),
        ({"calibrate": True}, {"environment": "E"}, ("calibrate",)),
        ({"calibrate": True}, {"environment": "E", "calibrate": True}, ()),
        ({}, {"environment": "old", "calibrate": True}, ("environment", "calibrate")),
        ({"test": True, "driver": True}, {}, ("environment", "test", "driver")),
        ({"test": True, "driver": True}, {"environment": "E", "test": True, "driver": "D"}, ()),
    ],
)
def test_what_is_missing_decides_the_steps(
    need: dict[str, bool], stamp: dict[str, object], expected: tuple[str]
) -> None:
    assert steps_for(need, stamp) == expected


def test_without_an_environment_nothing_of_the_stamp_holds() -> None:
    assert steps_for({}, {"environment": ""}, environment="") == ("environment",)


def test_a_fetched_driver_that_was_deleted_is_missing(tmp_path: Path) -> None:
    manifest = tmp_path / "lvp.json"
    stamp = {"environment": "E", "driver": "D", "driver_variables": {"VK_DRIVER_FILES": str(manifest)}}
    assert steps_for({"driver": True}, stamp) == ("driver",)
    manifest.touch()
    assert steps_for({"driver": True}, stamp) == ()


@pytest.mark.parametrize(
    ("words", "test", "driver", "goes_on"),
    [
        ([], False, False, False),
        (["--help"], False, False, False),
        (["info", "a.tif"], False, False, False),
        (["ingest", "a", "b"], False, False, False),
        (["traffic", "a"], False, False, False),
        (["demo"], False, True, False),
        (["show", "a.tif"], False, True, False),
        (["show", "--help"], False, False, False),
        (["bench", "image"], False, True, False),
        (["verify", "a.tif"], False, True, False),
        (["doctor"], False, True, True),
        (["test", "-k", "x"], True, True, True),
    ],
)
def test_only_verbs_that_draw_need_a_driver(words: list[str], test: bool, driver: bool, goes_on: bool) -> None:
    need = module("main").need_of(words)
    assert (need.test, need.driver) == (test, driver)
    assert need.goes_on or not goes_on


# The stamp and the lock


def test_a_stamp_comes_back_as_it_was(checkout: Any) -> None:
    stamp = module("state").Stamp("E", True, "D", {"VK_DRIVER_FILES": "/x"})
    checkout.write_stamp(stamp)
    assert checkout.read_stamp() == stamp
    assert [path.name for path in checkout.notes.iterdir()] == ["setup.json"]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"environment": "E", "future": 1}', '"E"'])
def test_a_stamp_that_cannot_be_read_is_none(checkout: Any, text: str) -> None:
    (checkout.notes / "setup.json").write_text(text)
    assert checkout.read_stamp() == module("state").Stamp()


def test_an_interrupted_set_up_voids_the_stamp(checkout: Any) -> None:
    checkout.write_stamp(module("state").Stamp("E"))
    checkout.unfinished.touch()
    assert checkout.read_stamp() == module("state").Stamp()


def installing(monkeypatch: pytest.MonkeyPatch, error: Exception | None = None) -> None:
    """Let the installation do nothing, or fail."""

    def install(checkout: Any, test: bool, say: Callable[[str], None]) -> None:
        if error:
            raise error

    monkeypatch.setattr(module("environment"), "install", install)


def test_adding_the_test_tools_keeps_the_driver(checkout: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    state, main = module("state"), module("main")
    installing(monkeypatch)
    driver = state.driver_fingerprint(os.environ)
    before = state.Stamp(checkout.environment_fingerprint(), driver=driver, driver_variables={"A": "b"})
    checkout.write_stamp(before)
    after = main.prepare(checkout, state.Need(test=True, driver=True))
    assert after == dataclasses.replace(before, test=True) == checkout.read_stamp()


def test_test_tools_that_cannot_be_fetched_leave_the_rest_usable(
    checkout: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    state, main = module("state"), module("main")
    installing(monkeypatch, state.SetupError("no network"))
    checkout.write_stamp(state.Stamp(checkout.environment_fingerprint()))
    with pytest.raises(state.SetupError):
        main.prepare(checkout, state.Need(test=True))
    assert main.prepare(checkout, state.Need()) == checkout.read_stamp() != state.Stamp()


def changed_settings(checkout: Any) -> None:
    (checkout.root / "pyproject.toml").write_text("[project]\nname = 'limen2'\n")


def another_python(checkout: Any) -> None:
    checkout.python.unlink()
    checkout.python.symlink_to("/bin/sh")


def new_venv(checkout: Any) -> None:
    (checkout.venv / "pyvenv.cfg").rename(checkout.venv / "old.cfg")
    (checkout.venv / "pyvenv.cfg").write_text("home = x\n")


@pytest.mark.parametrize("change", [changed_settings, another_python, new_venv])
def test_the_fingerprint_follows_what_set_up_depends_on(checkout: Any, change: Callable[..., None]) -> None:
    before = checkout.environment_fingerprint()
    assert before == checkout.environment_fingerprint()
    change(checkout)
    assert checkout.environment_fingerprint() not in ("", before)


def test_a_venv_without_its_python_has_no_fingerprint(checkout: Any) -> None:
    checkout.python.unlink()
    assert checkout.environment_fingerprint() == ""
    shutil.rmtree(checkout.venv)
    assert checkout.environment_fingerprint() == ""


def test_a_moved_checkout_is_a_new_one(checkout: Any, tmp_path: Path) -> None:
    before = checkout.environment_fingerprint()
    checkout.root.rename(tmp_path / "moved")
    moved = dataclasses.replace(checkout, root=tmp_path / "moved")
    assert moved.environment_fingerprint() not in ("", before)


def test_the_second_start_waits_for_the_first_and_says_so(checkout: Any) -> None:
    state = module("state")
    holder = (
        "import sys, time\nfrom pathlib import Path\nfrom launcher.state import Checkout, locked\n"
        "with locked(Checkout(Path(sys.argv[1])), print):\n    print('held', flush=True)\n    time.sleep(0.6)\n"
    )
    with started([*PYTHON, "-c", holder, checkout.root], env={**os.environ, "PYTHONPATH": str(TOOLS)}) as first:
        assert first.stdout is not None
        assert first.stdout.readline() == "held\n"
        said: list[str] = []
        began = time.monotonic()
        with state.locked(checkout, said.append):
            waited_s = time.monotonic() - began
    assert waited_s > 0.2
    assert len(said) == 1
    assert "waiting" in said[0]


def test_a_checkout_that_cannot_be_written_is_said_in_one_line(tmp_path: Path) -> None:
    state = module("state")
    with (
        pytest.raises(state.SetupError, match="not writable"),
        state.locked(state.Checkout(tmp_path / "absent"), print),
    ):
        pass


# Finding uv


def test_the_newest_wheel_for_the_platform_is_picked() -> None:
    tag = "manylinux_2_17_x86_64"
    names = [f"uv-{v}-py3-none-{tag}.manylinux2014_x86_64.whl" for v in ("0.9.9", "0.13.9", "0.13.10", "0.14.0rc1")]
    files: list[dict[str, object]] = [{"filename": name, "yanked": name.startswith("uv-0.13.10")} for name in names]
    files += [{"filename": "uv-1.0.0-py3-none-win_amd64.whl"}, {"filename": "uv-1.0.0.tar.gz"}]
    environment = module("environment")
    assert environment.pick_wheel(files, tag)["filename"] == names[1]
    with pytest.raises(LookupError, match="riscv"):
        environment.pick_wheel(files, "riscv")


def test_a_shim_that_does_not_answer_is_no_uv(checkout: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    environment = module("environment")
    shim = tmp_path / "uv"
    shim.write_text("#!/bin/sh\nexit 127\n")
    shim.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(environment, "_uv_by_pip", lambda folder: "no pip")
    monkeypatch.setattr(environment, "_uv_from_index", lambda folder: "no network")
    said: list[str] = []
    with pytest.raises(module("state").SetupError, match="no pip; no network"):
        environment.find_uv(checkout, said.append)
    assert [path.name for path in checkout.root.iterdir() if path.name.startswith(".boot")] == []


# The observer


@pytest.mark.parametrize(
    ("words", "needed"),
    [
        (["verify", "a"], True),
        (["test"], True),
        (["verify", "--help"], False),
        (["show", "a"], False),
        (["bench", "kernels"], True),
    ],
)
def test_only_what_judges_needs_the_observer(words: list[str], needed: bool) -> None:
    assert module("main").need_of(words).observer is needed


@pytest.mark.parametrize(
    ("words", "needed"),
    [(["calibrate", "boards"], True), (["calibrate", "solve", "--help"], False), (["show", "a"], False)],
)
def test_only_calibration_needs_opencv(words: list[str], needed: bool) -> None:
    assert module("main").need_of(words).calibrate is needed


def test_opencv_comes_as_the_extra_and_is_noted(checkout: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    state, main = module("state"), module("main")
    checkout.write_stamp(state.Stamp(checkout.environment_fingerprint()))
    folder = recording_uv(tmp_path / "bin", "nothing")
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
    assert main.prepare(checkout, state.Need(calibrate=True)).calibrate
    assert checkout.read_stamp().calibrate
    (asked,) = (folder / "asked").read_text().splitlines()
    assert asked.endswith("[calibrate]")


def test_opencv_that_cannot_be_had_is_said_and_tried_again(
    checkout: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    state, main = module("state"), module("main")
    checkout.write_stamp(state.Stamp(checkout.environment_fingerprint()))
    monkeypatch.setenv("PATH", f"{recording_uv(tmp_path / 'bin', '*calibrate*')}{os.pathsep}{os.environ['PATH']}")
    assert not main.prepare(checkout, state.Need(calibrate=True)).calibrate
    assert "OpenCV" in capsys.readouterr().err
    assert not checkout.read_stamp().calibrate


def recording_uv(folder: Path, fails: str) -> Path:
    """A uv that writes down what it is asked, with its wheel folders, and fails where its arguments match."""
    folder.mkdir()
    uv = folder / "uv"
    uv.write_text(
        f'#!/bin/sh\n[ "$1" = --version ] && exit 0\necho "$UV_FIND_LINKS|$*" >> {folder}/asked\n'
        f'case "$*" in {fails}) echo no such host >&2; exit 2;; esac\n'
    )
    uv.chmod(0o755)
    return folder


def observer_installed(
    checkout: Any, folder: Path, fails: str, monkeypatch: pytest.MonkeyPatch
) -> tuple[str, list[str]]:
    monkeypatch.setenv("PATH", f"{recording_uv(folder, fails)}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PIP_FIND_LINKS", "/a/wheels /b")
    monkeypatch.delenv("UV_FIND_LINKS", raising=False)
    reason = module("environment").install_observer(checkout, lambda text: None)
    return reason, (folder / "asked").read_text().splitlines()


def test_the_observer_comes_from_the_index_for_cpus(
    checkout: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reason, asked = observer_installed(checkout, tmp_path / "bin", "nothing", monkeypatch)
    assert reason == ""
    assert len(asked) == 2
    assert all(part in asked[0] for part in ("--no-deps", "torch==", "cvvdp==", "/whl/cpu"))
    assert asked[0].startswith("/a/wheels,/b|")
    assert asked[1].endswith("[verify]")


def test_without_that_index_only_a_build_for_cpus_is_taken(
    checkout: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reason, asked = observer_installed(checkout, tmp_path / "bin", "*whl/cpu*", monkeypatch)
    assert reason == ""
    assert "+cpu" in asked[1]
    assert "--extra-index-url" not in asked[1]


def test_an_observer_that_cannot_be_had_is_said_and_stops_nothing(
    checkout: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    state, main = module("state"), module("main")
    checkout.write_stamp(state.Stamp(checkout.environment_fingerprint()))
    monkeypatch.setenv("PATH", f"{recording_uv(tmp_path / 'bin', '*torch*')}{os.pathsep}{os.environ['PATH']}")
    stamp = main.prepare(checkout, state.Need(observer=True))
    said = [line for line in capsys.readouterr().err.splitlines() if "no such host" in line]
    assert len(said) == 1
    assert "observer" in said[0]
    assert not stamp.observer
    assert not checkout.read_stamp().observer


def test_the_launcher_and_the_error_name_the_same_versions() -> None:
    from limen.study.observer import INSTALL

    for package in module("environment").OBSERVER_PACKAGES:
        assert package in INSTALL[0].split()
    assert module("environment")._CPU_INDEX in INSTALL[0].split()


# Finding a driver


class Machine:
    """Stands in for wgpu and for the ways to a driver: what answers, and what answers after each way was gone."""

    def __init__(self, *backends: str) -> None:
        self.backends = frozenset(backends)
        self.ways: list[Callable[[], dict[str, str] | str]] = []
        self.said: list[str] = []

    def put_up(self, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
        driver = module("driver")
        seen = driver.Seen
        answer = "no driver; install one.", "install one"
        monkeypatch.setattr(driver, "_probe", lambda checkout, found: seen(self.backends, *answer))
        monkeypatch.setattr(driver, "_ways", lambda checkout, why, say: (say(why), *self.ways)[1:])
        return driver

    def gain(self, *backends: str) -> dict[str, str]:
        self.backends |= set(backends)
        return {"VK_DRIVER_FILES": "/x"}


@pytest.mark.parametrize("backends", [("Vulkan",), ("Vulkan", "OpenGL"), ("Metal",), ("D3D12", "OpenGL")])
def test_where_more_than_opengl_answers_nothing_is_brought(
    backends: tuple[str, ...], checkout: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine = Machine(*backends)
    assert machine.put_up(monkeypatch).find(checkout, machine.said.append) == {}
    assert machine.said == []


@pytest.mark.parametrize(("backends", "why"), [((), "no graphics driver here"), (("OpenGL",), "only OpenGL answers")])
def test_where_nothing_or_only_opengl_answers_vulkan_is_brought(
    backends: tuple[str, ...], why: str, checkout: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine = Machine(*backends)
    machine.ways = [lambda: "apt-get: no network", lambda: machine.gain("Vulkan")]
    found = machine.put_up(monkeypatch).find(checkout, machine.said.append)
    assert found == {"VK_DRIVER_FILES": "/x"}
    (line,) = machine.said
    assert line.startswith(why)


def test_where_vulkan_cannot_be_had_opengl_is_used_and_one_line_says_why(
    checkout: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    machine = Machine("OpenGL")
    machine.ways = [lambda: "apt-get: no network", lambda: {"A": "b"}]
    assert machine.put_up(monkeypatch).find(checkout, machine.said.append) == {}
    line = machine.said[-1]
    assert line.startswith("only OpenGL answers here, which is slower; install one (tried: apt-get: no network)")
    assert "still sees no Vulkan" in line
    assert "\n" not in line


def test_where_nothing_can_be_had_one_line_says_so(checkout: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    machine = Machine()
    machine.ways = [lambda: "apt-get: no network", lambda: {"A": "b"}]
    with pytest.raises(module("state").SetupError) as failed:
        machine.put_up(monkeypatch).find(checkout, machine.said.append)
    assert str(failed.value).startswith("no driver; install one. (tried: apt-get: no network)")
    assert "\n" not in str(failed.value)
    assert failed.value.code == 2


def test_a_system_without_apt_has_no_way(checkout: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    driver = module("driver")
    monkeypatch.setattr(driver.shutil, "which", lambda name: None)
    assert list(driver._ways(checkout, "no driver", print)) == []


def test_the_loader_is_pointed_at_an_unpacked_tree(tmp_path: Path) -> None:
    libraries = tmp_path / "usr/lib/x86_64-linux-gnu"
    manifests = tmp_path / "usr/share/vulkan/icd.d"
    for folder in (libraries, manifests):
        folder.mkdir(parents=True)
    (libraries / "libvulkan_lvp.so").touch()
    content = {"ICD": {"api_version": "1.1", "library_path": "/usr/lib/x86_64-linux-gnu/libvulkan_lvp.so"}}
    (manifests / "lvp_icd.x86_64.json").write_text(json.dumps(content))
    found = module("driver").loader_variables(tmp_path)
    assert found["LD_LIBRARY_PATH"] == str(libraries)
    written = json.loads(Path(found["VK_DRIVER_FILES"]).read_text())
    assert written["ICD"]["library_path"] == str(libraries / "libvulkan_lvp.so")
    assert module("driver").loader_variables(tmp_path) == found


def test_a_cache_with_a_colon_is_not_used(checkout: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    driver = module("driver")
    (tmp_path / "with:colon").mkdir()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "with:colon"))
    assert driver.cache_folder(checkout) == checkout.root / ".cache"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert driver.cache_folder(checkout) == tmp_path / "limen"


def test_our_library_path_goes_in_front() -> None:
    merged = module("variables").merged
    assert merged({"LD_LIBRARY_PATH": "/a"}, {"LD_LIBRARY_PATH": "/b"})["LD_LIBRARY_PATH"] == "/b:/a"
    assert merged({"LD_LIBRARY_PATH": "/a"}, {})["LD_LIBRARY_PATH"] == "/a"
    assert merged({}, {"LD_LIBRARY_PATH": "/b"}) == {"LD_LIBRARY_PATH": "/b"}


# Running


def test_the_arguments_reach_the_command_untouched(tmp_path: Path) -> None:
    command = module("main").command
    assert command(tmp_path, Path("/p"), ["show", "a b", "--x=*"])[1:] == [
        "-P",
        "-m",
        "limen.cli",
        "show",
        "a b",
        "--x=*",
    ]
    assert command(tmp_path, Path("/p"), ["test", "-k", "x"])[2:] == [
        str(tmp_path / "tools/launcher/checks.py"),
        "-k",
        "x",
    ]


def test_paths_for_pytest_are_those_of_the_folder_one_stands_in(tmp_path: Path) -> None:
    (tmp_path / "test_x.py").touch()
    arguments_from = module("checks").arguments_from
    assert arguments_from(["test_x.py::test_a", "-k", "word"], tmp_path) == [
        f"{tmp_path}/test_x.py::test_a",
        "-k",
        "word",
    ]


def test_every_check_names_a_module_that_the_test_group_installs() -> None:
    for _, words in (*module("checks").CHECKS, *module("checks").BESIDE):
        if words[0] == "-m":
            assert importlib.util.find_spec(words[1]), f"{words[1]} is not installed"


# A real start


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """The launcher alone, in a folder of its own."""
    root = tmp_path / "fresh clone"
    root.mkdir()
    shutil.copy(ROOT / "limen", root)
    shutil.copytree(TOOLS, root / "tools", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", root)
    return root


def slow_uv(folder: Path) -> Path:
    """A uv that makes half a .venv and then takes for ever."""
    folder.mkdir()
    uv = folder / "uv"
    uv.write_text('#!/bin/sh\n[ "$1" = --version ] && exit 0\nmkdir -p .venv/bin; touch begun; exec sleep 60\n')
    uv.chmod(0o755)
    return folder


@pytest.mark.parametrize(("number", "alone"), [(signal.SIGINT, False), (signal.SIGINT, True), (signal.SIGTERM, True)])
def test_an_interrupted_set_up_leaves_no_stamp_and_one_line(
    copy: Path, tmp_path: Path, number: int, alone: bool
) -> None:
    path = f"{slow_uv(tmp_path / 'bin')}{os.pathsep}{os.environ['PATH']}"
    variables = {**os.environ, "PATH": path, "LIMEN_NO_SETUP": ""}
    with started([*PYTHON, copy / "limen", "info"], env=variables) as process:
        while not (copy / "begun").exists():
            assert process.poll() is None, process.communicate()
            time.sleep(0.02)
        if alone:
            os.kill(process.pid, number)
        else:
            os.killpg(process.pid, number)  # as a terminal does
        _, remarks = process.communicate(timeout=20)
    assert process.returncode == 130
    assert remarks.splitlines()[-1] == "limen: set-up interrupted; the next start does it again"
    assert "Traceback" not in remarks
    assert not (copy / ".limen/setup.json").exists()
    assert (copy / ".limen/unfinished").exists()


def test_a_set_up_that_fails_says_why_in_one_line(copy: Path, tmp_path: Path) -> None:
    uv = slow_uv(tmp_path / "bin") / "uv"
    uv.write_text('#!/bin/sh\n[ "$1" = --version ] && exit 0\necho the disk is full >&2; exit 2\n')
    variables = {**os.environ, "PATH": f"{uv.parent}{os.pathsep}{os.environ['PATH']}", "LIMEN_NO_SETUP": ""}
    done = subprocess.run(
        [sys.executable, copy / "limen", "info"], env=variables, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert "the disk is full" in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
    assert not (copy / ".limen/setup.json").exists()


def test_the_help_of_test_needs_no_set_up(copy: Path) -> None:
    done = subprocess.run(
        [sys.executable, copy / "limen", "test", "--help"], capture_output=True, text=True, check=True
    )
    assert "PYTEST ARGS" in done.stdout
    assert not (copy / ".limen").exists()


def test_without_set_up_the_exit_code_and_the_folder_are_the_commands_own(copy: Path, tmp_path: Path) -> None:
    package = copy / "src/limen/cli"
    package.mkdir(parents=True)
    (package.parent / "__init__.py").touch()
    (package / "__init__.py").touch()
    (package / "__main__.py").write_text("import os, sys; print(os.getcwd(), *sys.argv[1:]); sys.exit(42)")
    done = subprocess.run(
        [sys.executable, copy / "limen", "info", "a b"],
        env={**os.environ, "LIMEN_NO_SETUP": "1"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 42
    assert done.stdout == f"{tmp_path} info a b\n"


def test_an_old_python_could_at_least_read_the_script() -> None:
    """Its grammar must be that of Python 3.6, or the message about the version is never reached."""
    ast.parse((ROOT / "limen").read_text(), feature_version=(3, 6))
