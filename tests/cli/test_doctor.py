"""``limen doctor``: problems and cures from what the machine answers, JSON, exit codes."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from limen.cli import doctor
from limen.gpu import adapters
from support.processes import LIMEN, finished

GPU = adapters.AdapterInfo(
    name="A GPU",
    backend="Vulkan",
    kind="DiscreteGPU",
    driver="1.2.3",
    features=("float32-filterable",),
    limits={"max-texture-dimension-2d": 16384, "max-texture-array-layers": 2048},
)
SOFTWARE = dataclasses.replace(GPU, name="llvmpipe", kind="CPU")


def problems_with(*found: adapters.AdapterInfo) -> dict[str, doctor.Problem]:
    return {problem.problem: problem for problem in doctor.examine(lambda: list(found)).problems}


def about_adapters(*found: adapters.AdapterInfo) -> list[str]:
    return [problem.problem for problem in doctor._adapter_problems(list(found))]


def test_a_good_gpu_is_no_problem() -> None:
    assert about_adapters(GPU) == []
    assert about_adapters(GPU, SOFTWARE) == []


def test_no_adapter_stops_drawing_and_names_the_package() -> None:
    stopping = [problem for problem in problems_with().values() if problem.stops_drawing]
    assert len(stopping) == 1
    assert stopping[0].cure == adapters.driver_advice()


def test_a_missing_observer_is_noted_with_the_two_commands_that_bring_it() -> None:
    assert doctor._observer_problems(()) == []
    (problem,) = doctor._observer_problems(("torch", "pycvvdp"))
    assert "torch, pycvvdp" in problem.problem
    assert problem.cure.count("pip install") == 2
    assert not problem.stops_drawing


def test_missing_opencv_is_noted_with_the_command_that_brings_it() -> None:
    assert doctor._opencv_problems(True) == []
    (problem,) = doctor._opencv_problems(False)
    assert "pip install" in problem.cure
    assert not problem.stops_drawing


@pytest.mark.parametrize(
    ("info", "word"),
    [
        (SOFTWARE, "software"),
        (dataclasses.replace(GPU, backend="OpenGL"), "OpenGL"),
        (dataclasses.replace(GPU, limits={"max-texture-dimension-2d": 4096}), "4096"),
    ],
)
def test_a_weak_adapter_is_noted_and_stops_nothing(
    info: adapters.AdapterInfo, word: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(adapters.WISH, raising=False)
    (problem,) = doctor._adapter_problems([info])
    assert word in problem.problem
    assert not problem.stops_drawing


def test_a_missing_package_stops_drawing() -> None:
    (problem,) = doctor._package_problems({"wgpu": None, "numpy": "2.0", "pyvips-binary": None})
    assert problem.problem == "not installed: wgpu"
    assert problem.cure.endswith("-m pip install wgpu")
    assert problem.stops_drawing


def test_without_a_desktop_no_window_opens(monkeypatch: pytest.MonkeyPatch) -> None:
    if sys.platform != "linux":
        pytest.skip("only Linux tells by its variables")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    report = doctor.examine(lambda: [GPU])
    assert not report.machine.window
    assert any("no window can open" in problem.problem for problem in report.problems)


def test_a_crash_of_the_driver_reads_as_no_adapter(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    script = tmp_path / "crash.py"
    script.write_text('import os\nprint(\'{"advice": "x"}\', flush=True)\nos.abort()\n')
    monkeypatch.setattr(adapters, "__file__", str(script))
    assert adapters.list_adapters() == []


@pytest.mark.parametrize(
    ("system", "families", "expected"),
    [
        ("Linux", ["debian"], "apt-get install mesa-vulkan-drivers libvulkan1"),
        ("Linux", ["linuxmint", "ubuntu", "debian"], "apt-get install mesa-vulkan-drivers libvulkan1"),
        ("Linux", ["rocky", "rhel", "fedora"], "dnf install mesa-vulkan-drivers vulkan-loader"),
        ("Linux", ["arch"], "pacman -S vulkan-swrast vulkan-icd-loader"),
        ("Linux", ["alpine"], "musl"),
        ("Linux", [], "vulkan-swrast"),
        ("Darwin", [], "Metal"),
        ("Windows", [], "DirectX 12"),
    ],
)
def test_the_advice_fits_the_system(system: str, families: list[str], expected: str) -> None:
    advice = adapters.driver_advice(system, families)
    assert expected in advice
    assert "\n" not in advice


def doctor_in_a_process(**variables: str) -> subprocess.CompletedProcess[str]:
    return finished([*LIMEN, "doctor", "--json"], timeout_s=120, env={**os.environ, **variables})


@pytest.mark.gpu
def test_json_is_one_object_and_this_machine_can_draw() -> None:
    done = doctor_in_a_process()
    report = json.loads(done.stdout)
    assert done.returncode == 0, done.stderr
    assert report["adapters"][0]["limits"]["max-texture-dimension-2d"] >= 8192
    assert all(set(problem) >= {"problem", "cure"} for problem in report["problems"])
    assert report["versions"]["wgpu"]
    assert report["machine"]["cpu_cores"] >= 1
