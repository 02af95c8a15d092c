"""What a notebook needs: public names, values shown in a few lines, figures, and the forms of other libraries."""

import inspect
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from matplotlib import rc_context
from matplotlib.figure import Figure
from plants.elastic_arm import arm, started_elsewhere
from plants.elastic_arm import measured as measured
from plants.elastic_arm import result as result
from plants.friction_study import friction_result
from plants.paths import CONFIGS
from plants.refusals import refused
from plants.report_values import TRUTH, fit_result, plan
from plants.steady_record import steady_record

import elastid
from elastid.excitation.spec import MultisineSpec
from elastid.fit.identify import identify
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.linear.linearise import linearise
from elastid.model.formulation import serial
from elastid.response import in_quantity
from elastid.store.measured import read_records, write_records
from elastid.store.results import read_fit, write_fit
from elastid.study import load_robot, load_study

MAX_SHOWN = 2500  # characters, about 25 lines of a prompt


def test_every_public_name_is_listed_and_there() -> None:
    """Before any of them is used, and without loading what they need."""
    code = "import sys, elastid; dir(elastid); print(*{'numpy', 'casadi', 'scipy', 'matplotlib'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "\n"
    with pytest.raises(AttributeError, match="no attribute 'fitt'"):
        _ = elastid.fitt


def test_values_show_themselves_in_a_few_lines(measured, result) -> None:
    """Text for a prompt and a table for a notebook, with the numbers that one asks for first."""
    study = load_study(str(CONFIGS / "linkage_arm.yml"))
    model = result.model("c1")
    friction = friction_result()
    for value, says in (
        (study, "linkage_arm.yml: Study 'linkage_arm'"),
        (study.study, "k_*, d_*, fm_*"),
        (study.study.robot, "Robot linkage arm: 4 bodies, 2 motors, 1 loop"),
        (study.study.robot, "2      lower      y     100         8e+05 N*m/rad    400 N*m*s/rad"),
        (plan(), "RMS of motor 1, motor 2, motor 3 in N*m"),
        (steady_record(), "periods of"),
        (measured[0], "2 x 2 at 60 lines, 2 to 60 Hz"),
        (result, f"k_1        {round(result.values['k_1'], -1):.0f}"),
        (model, "natural frequency in Hz"),
        (friction, "partly"),
    ):
        assert says in repr(value)
        assert len(repr(value)) < MAX_SHOWN
        assert value._repr_html_().count("<table>") == 1
    assert "motor &lt;1&gt;" in replace(measured[0], outputs=("motor <1>", "motor 2"))._repr_html_()


def test_a_response_without_covariance_says_that_its_noise_is_unknown(measured, result) -> None:
    """In the response, and in message, status and table of its fit, whose intervals come from the residuals."""
    bare = [replace(G, noise=None, total=None) for G in measured]
    assert "its noise is unknown" in repr(bare[0])
    found = identify(bare, started_elsewhere(arm(), 1.3), FitSpec(starts=1))
    assert (result.status, found.status) == ("converged", "noise_unknown")
    assert "the noise is unknown" in found.message
    assert "std, of the residuals" in repr(found)


@pytest.mark.slow
def test_figures_are_drawn_of_values(measured, result) -> None:
    """Bode with the model dense and its band, parameters, friction curve; a notebook shows each as a picture."""
    model = result.model("c1")
    figure = elastid.plot.bode(measured[0], model)
    assert len(figure.axes) == 8
    points, line = figure.axes[0].lines[0], figure.axes[0].lines[-1]
    assert (points.get_label(), line.get_label()) == ("measured", "model")
    assert len(line.get_xdata()) > 900
    assert len(figure.axes[0].collections) == 1
    assert not elastid.plot.bode(measured[0], model, band=False).axes[0].collections
    assert isinstance(elastid.plot.friction_curve(friction_result(), "elbow"), Figure)
    assert elastid.plot.parameters(fit_result(), TRUTH)._repr_png_().startswith(b"\x89PNG")


def test_notebook_figure_has_page_style() -> None:
    picture = elastid.plot.friction_curve(friction_result(), "elbow")._repr_png_()
    with rc_context({"font.size": 22, "axes.facecolor": "black", "figure.dpi": 40, "savefig.transparent": True}):
        assert elastid.plot.friction_curve(friction_result(), "elbow")._repr_png_() == picture


def test_figures_refuse_what_does_not_belong_together(measured, result) -> None:
    """A model of other places, a joint that was not identified: the message has the names there are."""
    other = replace(measured[0], inputs=("motor 1", "motor 7"))
    with pytest.raises(
        ValueError, match=r"the model has inputs motor 1, motor 2 .* measured response motor 1, motor 7"
    ):
        elastid.plot.bode(other, result.model("c1"))
    with pytest.raises(KeyError, match="no friction of joint nose; there are"):
        elastid.plot.friction_curve(friction_result(), "nose")


@pytest.mark.slow
def test_responses_and_models_go_to_python_control_and_back(measured, result) -> None:
    """To rounding, with the names of their channels; a response from there has no noise."""
    back = elastid.Response.from_control(measured[0].to_control(), measured[0].configuration)
    np.testing.assert_allclose(back.freq_hz, measured[0].freq_hz, rtol=1e-14)
    np.testing.assert_array_equal(back.G, measured[0].G)
    assert (back.inputs, back.outputs, back.uncertainty) == (measured[0].inputs, measured[0].outputs, None)
    model = result.model("c1")
    system, f = model.to_control(pade=4), measured[0].freq_hz
    there = np.moveaxis(np.asarray(system(2j * np.pi * f, squeeze=False)), 2, 0)
    np.testing.assert_allclose(there, model.response(f).G, rtol=1e-6, atol=1e-9)
    assert tuple(system.input_labels) == model.linear.inputs


@pytest.mark.slow
def test_responses_and_results_become_labelled_tables(measured, result) -> None:
    """xarray by frequency and channel, pandas by parameter; a held number has neither std nor interval."""
    labelled = measured[0].to_xarray()
    one = labelled.G.sel(output="motor 2", input="motor 1", freq_hz=measured[0].freq_hz[7])
    assert complex(one) == measured[0].G[7, 1, 0]
    assert labelled.attrs["unit"] == "(rad/s^2)/(N*m)"
    table = result.to_dataframe()
    assert table.loc["k_1", "value"] == result.values["k_1"]
    assert (table.loc["k_1", "low"], table.loc["k_1", "high"]) == result.interval("k_1")
    assert table[~table.free][["std", "low", "high"]].isna().all(axis=None)
    assert table[table.free]["std"].notna().all()


def test_a_package_that_is_missing_says_how_to_install_it(measured, monkeypatch) -> None:
    """xarray and pandas are extras."""
    monkeypatch.setitem(sys.modules, "xarray", None)
    with refused("install/missing-package", holds="xarray"):
        measured[0].to_xarray()


def test_every_public_function_takes_a_path_as_text(tmp_path, result) -> None:
    """By its signature, and where it counts: what is written under a text is read under it."""
    functions = [value for value in (getattr(elastid, name) for name in elastid.__all__) if inspect.isfunction(value)]
    paths = [p.annotation for f in functions for p in inspect.signature(f).parameters.values() if "Path" in str(p)]
    assert len(paths) >= 9
    assert all("Path | str" in str(each) for each in paths)
    write_fit(f"{tmp_path}/fit.h5", result)
    assert read_fit(f"{tmp_path}/fit.h5").values == result.values
    assert load_robot(f"{CONFIGS}/robots/linkage_arm.yml").name == "linkage arm"


def test_mistake_is_answered_with_valid_names(measured, result, tmp_path) -> None:
    """No index of a tuple, no shape inside CasADi, no attribute of an inner value; and no file is begun."""
    model, response, system = serial(arm()), measured[0], result.model("c1").to_control()
    home = elastid.Configuration("home", np.zeros(2))
    assert result.model(response.configuration).linear.configuration.name == "c1"
    for wrong, error in (
        (lambda: linearise(model, home, np.append(model.theta, 0.0), ("motor 1",), "position"), ValueError),
        (lambda: linearise(model, home, model.theta, ("motor 1",), "speed"), KeyError),
        (lambda: in_quantity(response, "speed"), KeyError),
        (lambda: replace(response, quantity="speed"), KeyError),
        (lambda: response.lines(np.ones(3, bool)), ValueError),
        (lambda: plan().torque(replace(plan().experiments[0], configuration=home)), KeyError),
        (lambda: replace(result, linear=()).model("c1"), ValueError),
        (lambda: result.model("c9"), KeyError),
        (lambda: result.values["k_9"], KeyError),
        (lambda: elastid.plot.parameters(result, {"k_9": 1.0}), KeyError),
        (lambda: identify(measured, arm(), {}), TypeError),
        (lambda: estimate(steady_record(), EstimatorSpec()), TypeError),
        (lambda: elastid.plot.bode(response, result), TypeError),
        (lambda: elastid.Response.from_control(system, response.configuration), TypeError),
        (lambda: replace(response, configuration="c1"), TypeError),
        (lambda: write_fit(tmp_path / "no.h5", response), TypeError),
    ):
        with pytest.raises(error):
            wrong()
    assert not list(tmp_path.iterdir())


def test_frequencies_are_numbers_in_a_row(result) -> None:
    """One or several; what is no such thing is refused before anything is computed."""
    model = result.model("c1")
    assert model.response(10.0).G.shape == (1, 2, 2)
    for given in ("10 Hz", np.ones((2, 3)), [1j], [1.0, np.inf], [1.0, np.nan]):
        for answer in (model.response, model.response_std):
            with pytest.raises(ValueError, match="freq_hz"):
                answer(given)
    with pytest.raises(ValueError, match="pade is -1; give the order of the approximation"):
        model.to_control(pade=-1)


def test_sections_made_in_python_refuse_words_that_are_no_choice(measured) -> None:
    """As a study does: no misspelt word is taken for a default, no number of another unit, no list for names."""
    assert elastid.Spring(stiffness="3 kN*m/rad") == elastid.Spring(stiffness=3000.0)
    for make, says in (
        (lambda: FitSpec(criterion="complx"), "^criterion: "),
        (lambda: FitSpec(parameters=["k_1"]), "^parameters: "),
        (lambda: elastid.Joint("1", "w"), "^axis"),
        (lambda: elastid.Spring(stiffness="3 kg"), "^stiffness: .*3 kg"),
        (lambda: MultisineSpec(500.0, "4 m", (2.0, 60.0), 50.0), "^period: .*4 m"),
    ):
        with pytest.raises(ValueError, match=says):
            make()
    asked = FitSpec(parameters={"k_1": ParameterSpec(start="3 kg")})
    with refused("fit/parameters", place="fit.parameters.k_1", holds="3 kg"):
        identify(measured, arm(), asked)


def test_sections_made_in_python_take_lists_and_arrays_for_tuples() -> None:
    """A robot of lists is that of tuples: it is equal, and has a hash, by which its equations are kept."""
    numbers = {"joints": arm().bodies[0].joints, "center_of_mass": (0.1, 0.0, 0.2), "inertia": (3.0, 2.0, 2.0)}
    tuples, lists = (elastid.Body("link", **{n: make(x) for n, x in numbers.items()}) for make in (tuple, list))
    assert elastid.Body("link", center_of_mass=np.array([0.1, 0.0, 0.2])) == replace(tuples, joints=(), inertia=0.0)
    assert elastid.Robot("arm", [lists]) == elastid.Robot("arm", (tuples,))
    with pytest.raises(ValueError, match=r"^criterion: "):
        FitSpec(criterion=np.str_("complx"))
    assert hash(elastid.Robot("arm", [lists])) == hash(elastid.Robot("arm", (tuples,)))


def test_records_of_two_configurations_make_no_response(tmp_path) -> None:
    """They would be averaged into one of neither; records are read by their configuration."""
    one = steady_record()
    other = replace(one, name="other", configuration=elastid.Configuration("other", one.configuration.angles + 0.5))
    with refused("frf/records", holds="other"):
        estimate([one, other], EstimatorSpec())
    write_records(tmp_path / "records.h5", [one, other])
    assert [record.name for record in read_records(tmp_path / "records.h5", "other")] == ["other"]
    with refused("run/earlier-stage", place="records.h5", holds=("othr", "other")):
        list(read_records(tmp_path / "records.h5", "othr"))
    with refused("files/kind", place=str(tmp_path)):
        read_fit(tmp_path)
