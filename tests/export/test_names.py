"""Every target of an export is what it should be whatever the names are: it compiles, or its reader finds the names."""

import csv
import runpy
import shutil
import subprocess
import warnings
import zipfile
from pathlib import Path
from xml.etree import ElementTree as ET

import casadi as ca
import numpy as np
import pytest
from plants.hostile_names import HOSTILE, hostile_model
from plants.refusals import refused
from ruamel.yaml import YAML
from scipy.io import loadmat

from elastid.app.identified_robot import robot_of_fit
from elastid.export.code import write_c, write_casadi
from elastid.export.control import write_control, write_responses_control
from elastid.export.csv import write_csv, write_responses_csv
from elastid.export.fmu import Subject, unit_sources, write_fmu
from elastid.export.matlab import write_matlab, write_responses_matlab
from elastid.export.mujoco import write_mujoco
from elastid.export.numbers import interval_lines
from elastid.export.uff import write_uff
from elastid.export.urdf import write_urdf
from elastid.fit.fitted_robot import FittedRobot
from elastid.robot.urdf import read_elements
from elastid.study import load_robot

STRIDE = 3
needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler on this machine")


@pytest.fixture(scope="module", params=range(0, len(HOSTILE), STRIDE))
def model(request: pytest.FixtureRequest) -> FittedRobot:
    """Two axes with six of the names, two configurations and a study with three."""
    return hostile_model(request.param)


@needs_compiler
def test_c_compiles_and_casadi_loads(model: FittedRobot, tmp_path: Path) -> None:
    """No name ends the comment in which it stands, none nests one."""
    source, header, _ = write_c(tmp_path, model)
    flags = ["-std=c99", "-Wall", "-Wextra", "-Wno-unused-parameter", "-Wno-unused-function", "-Werror"]
    program = tmp_path / "all.c"
    program.write_text(f'#include "{header.name}"\n', encoding="utf-8")
    for file, more in ((program, []), (source, ["-Wno-all", "-Wno-extra"])):
        subprocess.run(["cc", *flags, *more, "-fsyntax-only", str(file)], check=True, cwd=tmp_path)
    for path in write_casadi(tmp_path, model)[:-1]:
        assert ca.Function.load(str(path)).name() == path.stem


def test_robot_file_reads_back_in_both_versions_of_yaml(model: FittedRobot, tmp_path: Path) -> None:
    """The same robot, and nothing but its keys on the top level."""
    path = tmp_path / "robot.yml"
    path.write_text(robot_of_fit(model.name, model.robot, None, interval_lines(model)), encoding="utf-8")
    assert load_robot(path) == model.robot
    reader = YAML(typ="safe", pure=True)
    reader.version = (1, 1)
    older = reader.load(path)
    assert set(older) <= {"name", "bodies", "gravity", "source", "frames"}
    assert older["bodies"][0]["name"] == model.robot.bodies[0].name
    assert older["bodies"][0]["joints"][0]["name"] == model.robot.joints[0].name


def test_urdf_and_mjcf_have_the_names(model: FittedRobot, tmp_path: Path) -> None:
    (path,) = write_urdf(tmp_path, model)
    joints = {joint.attributes["name"] for joint in read_elements(path).all("joint")}
    assert {joint.name for joint in model.robot.joints} <= joints
    bodies = [body.name for body in model.robot.bodies]
    if "world" in bodies:
        with refused("export/not-representable"):
            write_mujoco(tmp_path, model)
        return
    (path,) = write_mujoco(tmp_path, model)
    assert [each.get("name") for each in ET.parse(path).findall("worldbody//body")] == bodies
    mujoco = pytest.importorskip("mujoco", reason="the independent implementation is in the group 'oracles'")
    engine = mujoco.MjModel.from_xml_string(path.read_text(encoding="utf-8"))
    assert [engine.body(i + 1).name for i in range(len(bodies))] == bodies


def test_units_have_the_names(model: FittedRobot) -> None:
    """Both descriptions are XML, whose names of variables differ."""
    sources, described = unit_sources(Subject.fitted(model))
    for text in described.values():
        root = ET.fromstring(text)
        names = [each.get("name") for each in root.findall("ModelVariables/*")]
        assert len(set(names)) == len(names)
        assert f"k_{model.robot.joints[0].name}" in names
        assert root.get("modelName") == model.name
    assert not any(model.robot.name in text for name, text in sources.items() if len(model.robot.name) > 12)


@pytest.mark.slow
@needs_compiler
def test_units_are_built_and_read(model: FittedRobot, tmp_path: Path) -> None:
    fmpy = pytest.importorskip("fmpy", reason="the independent implementation is in the group 'oracles'")
    for path in write_fmu(tmp_path, model):
        with zipfile.ZipFile(path) as archive:
            assert archive.testzip() is None
        assert fmpy.read_model_description(str(path)).modelName == model.name


def test_tables_have_the_names_and_no_formula(model: FittedRobot, tmp_path: Path) -> None:
    """No cell that is a text begins as a formula of a spreadsheet."""
    paths = [*write_csv(tmp_path / "fit", model), *write_responses_csv(tmp_path / "frf", model.name, model.measured)]
    assert all(path.parent.parent == tmp_path for path in paths)
    for path in paths:
        with path.open(encoding="utf-8", newline="") as file:
            for row in csv.reader(file):
                for cell in row:
                    assert cell[:1] not in ("=", "+", "@", "\t") or is_number(cell)
                    assert cell[:1] != "-" or is_number(cell)
    header = (tmp_path / "frf" / paths[-2].name).read_text(encoding="utf-8").splitlines()[0]
    assert next(csv.reader([header]))[0] == "freq_hz"


def is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def test_python_control_loads_them(model: FittedRobot, tmp_path: Path) -> None:
    """By the scripts that are written, under the names of the configurations."""
    pytest.importorskip("control")
    names = [G.configuration.name for G in model.measured]
    _, loader = write_control(tmp_path, model)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        script = runpy.run_path(str(loader))
        systems, _ = script["load"]()
        assert list(systems) == names == list(script["measured"]())
        assert f"k_{model.robot.joints[0].name}" in script["parameters"]()
        _, loader = write_responses_control(tmp_path, model.name, model.measured)
        assert list(runpy.run_path(str(loader))["load"]()) == names
    assert systems[names[0]].input_labels == [each.replace(".", "_") for each in model.measured[0].inputs]


def test_matlab_has_the_names(model: FittedRobot, tmp_path: Path) -> None:
    """In the variables; a script has them in its comments alone."""
    data, script = write_matlab(tmp_path, model)
    content = loadmat(data, simplify_cells=True)
    assert [each["configuration"] for each in content["model"]] == [G.configuration.name for G in model.measured]
    assert list(content["measured"][0]["InputName"]) == list(model.measured[0].inputs)
    write_responses_matlab(tmp_path, model.name, model.measured)
    for file in (script, tmp_path / "load_responses.m"):
        lines = file.read_text(encoding="utf-8").split("\n")
        own = [line for line in lines if f"model of {model.name}," in line or f"responses of {model.name}," in line]
        assert len(own) == 1
        assert own[0].startswith("% ")


def test_universal_files_are_read(model: FittedRobot, tmp_path: Path) -> None:
    pyuff = pytest.importorskip("pyuff")
    for path in write_uff(tmp_path, model.name, model.measured):
        if path.suffix == ".uff":
            sets = pyuff.UFF(str(path)).read_sets()
            assert len(sets) == len(model.measured[0].outputs) * len(model.measured[0].inputs)
            np.testing.assert_allclose(sets[0]["x"], model.measured[0].freq_hz, rtol=1e-5)
