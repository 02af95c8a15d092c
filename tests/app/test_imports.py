"""What a command must not load before it needs it: `--help` and `check` answer at once."""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from elastid.app.cli import run_command

HEAVY = {"casadi", "scipy", "h5py", "matplotlib", "control", "pandas", "jinja2"}
SPECS = [
    "elastid.base.errors", "elastid.robot", "elastid.parameters", "elastid.record", "elastid.response",
    "elastid.excitation.spec", "elastid.experiment.specs.experiment", "elastid.frf.spec", "elastid.fit.spec",
    "elastid.model.spec", "elastid.simulation.spec", "elastid.validation.spec", "elastid.study", "elastid.app.overview",
]  # fmt: skip


def loaded_after(code: str) -> set[str]:
    """The packages, and the modules below them, in a fresh interpreter once `code` has run."""
    report = "; import sys; sys.stdout = sys.__stdout__; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code + report], capture_output=True, text=True, check=True)
    return set(done.stdout.splitlines()[-1].split())


def test_the_package_itself_loads_nothing() -> None:
    """Ctrl-C has its answer in the program's first lines, which Python runs after the package's own."""
    assert loaded_after("import elastid") - loaded_after("pass") == {"elastid"}


def test_help_loads_neither_numpy_nor_pydantic() -> None:
    loaded = loaded_after("from elastid.app.cli import run_command; run_command(['--help'])")
    assert "click" in loaded
    assert not loaded & (HEAVY | {"numpy", "pydantic", "ruamel", "rich"})


@pytest.mark.parametrize("edit", ["", "seed: -1"])
def test_check_loads_no_heavy_package(tiny: Path, edit: str) -> None:
    """Whether the study is right or wrong."""
    tiny.write_text(tiny.read_text().replace("seed: 1", edit or "seed: 1"))
    loaded = loaded_after(f"from elastid.app.cli import run_command; run_command(['check', {str(tiny)!r}])")
    assert {"numpy", "pydantic"} <= loaded
    assert not loaded & (HEAVY | {"rich"})


def test_specs_and_values_load_no_heavy_package() -> None:
    """A section of a study is plain data, wherever it lives; value types know no YAML."""
    assert not loaded_after("; ".join(f"import {module}" for module in SPECS)) & HEAVY
    values = "; ".join(
        f"import {module}" for module in SPECS if module not in ("elastid.study", "elastid.app.overview")
    )
    assert not loaded_after(values) & (HEAVY | {"ruamel", "click"})


STAGES = {
    "estimate": {"casadi", "scipy", "matplotlib", "jinja2"},
    "fit": {"scipy.optimize", "matplotlib", "jinja2"},
    "validate": {"scipy.optimize", "matplotlib", "jinja2"},
    "report": {"scipy.optimize", "matplotlib.pyplot", "matplotlib.backends.backend_pdf"},
}


@pytest.mark.slow
def test_a_stage_loads_what_it_works_with(tiny: Path) -> None:
    """Not the page in order to estimate, nor SciPy's optimisers and distributions, which take longest to load."""
    code = f"""
import sys
from elastid.app.cli import cli
from elastid.app.run import stamps
from elastid.study import load
from importlib import import_module
stamps(load({str(tiny)!r}))
for stage in {tuple(STAGES)}:
    import_module("elastid.app.stages." + stage)
    print(*sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    for (stage, unneeded), loaded in zip(STAGES.items(), done.stdout.splitlines()[-len(STAGES) :], strict=True):
        assert f"elastid.app.stages.{stage}" in loaded.split()
        never = {"scipy.signal", "scipy.stats", "control", "pandas", "rich"}
        assert not set(loaded.split()) & (unneeded | never), stage


MAX_LINES = {"fit": 32_000, "report": 23_000}  # of the package, that a command with one stage loads


@pytest.mark.slow
def test_a_command_loads_few_lines_and_report_no_solver(tiny: Path) -> None:
    run = ["--run", str(tiny.parent / "run"), "--jobs", "1", "-qq"]
    assert run_command(["run", str(tiny), *run]) == 0
    for stage, most in MAX_LINES.items():
        words = ["run", str(tiny), stage, *run]
        loaded = loaded_after(f"from elastid.app.cli import run_command; assert run_command({words}) == 0")
        files = [find_spec(name) for name in loaded if name.startswith("elastid.")]
        paths = [Path(file.origin) for file in files if file is not None and file.origin is not None]
        assert sum(len(path.read_text().splitlines()) for path in paths if path.suffix == ".py") <= most
    assert not loaded & {"elastid.linear.linearise", "elastid.fit.fitted_robot", "elastid.modal.estimate"}


AT_NUMPY = """
import os, sys
class Finder:
    def find_spec(self, name, *rest):
        if name == "numpy":
            print(os.environ.get("OPENBLAS_NUM_THREADS"), flush=True)
            os._exit(0)
sys.meta_path.insert(0, Finder())
from elastid.app.cli import run_command
run_command(sys.argv[1:])
"""


@pytest.mark.parametrize("words", [["demo", "--run"], ["new"], ["check"], ["fleet"], ["inspect"]])
def test_one_blas_thread_is_asked_for_before_numpy_is_loaded(words: list[str], tiny: Path) -> None:
    """Several threads add in an order of their own, so that bytes would not be those of the seed."""
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    command = [sys.executable, "-c", AT_NUMPY, *words, str(tiny if words[0] != "demo" else tiny.parent / "demo")]
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    assert done.stdout.splitlines()[-1] == "1"
