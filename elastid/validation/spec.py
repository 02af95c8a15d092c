"""The sections `validation` and `compare` of a study."""

from typing import Annotated

from elastid.base.names import Name, check_different
from elastid.base.section import Key, section
from elastid.experiment.specs.experiment import ToolSpec


@section
class ValidationSpec:
    """Configurations, friction logs and tool responses that validate the model."""

    # fmt: off
    configurations: Annotated[tuple[str, ...], Key("Validation configurations, excluded from the fit; in a friction "
        "study, file names of motion logs without extension.", "one of five or more, not the most extreme one; without "
        "any, only residual tests of fitted data remain.", distinct=True)] = ()
    tool: Annotated[ToolSpec | None, Key("Responses measured at the tool that the fitted model predicts (default: no "
        "such validation).", "a few hammer hits validate the model at the tool; hits under the section tool are fitted "
        "instead.")] = None
    # fmt: on


@section
class VariantSpec:
    """Another model for `elastid compare`: its differences from the study's model."""

    # fmt: off
    name: Annotated[Name, Key("Name of the model in the comparison.", "a few words, which tables and figures display.")]
    rigid: Annotated[tuple[str, ...], Key("Rigid joints and rods (by loop name); an undriven joint is removed.",
        "the elastic joint or rod in question; if the prediction does not degrade, its spring is not needed.")] = ()
    motor_coupling: Annotated[bool, Key("If true, the rotors move with the bodies that carry them; false neglects this "
        "motion.", "false for models of tools that neglect it; with high ratios it matters mainly in wrists.")] = True
    set: Annotated[tuple[str, ...], Key("Keys of the study with values as on the command line, such as "
        "model.formulation=serial or robot.gears.0.springs=before.", "for other differences, such as the band or "
        "weights of the fit; one entry per key.")] = ()
    # fmt: on


@section
class CompareSpec:
    """Models that `elastid compare` fits and ranks."""

    # fmt: off
    folds: Annotated[int, Key("Number of folds of the cross-validation over configurations; 0 leaves out one "
        "configuration at a time.", "4 or 5 for many configurations: each variant costs one fit per fold.")] = 0
    variants: Annotated[tuple[VariantSpec, ...], Key("Models compared with the study's own (default: the robot without "
        "motor coupling, without each undriven elastic joint, and, with loops, in its other formulation and the "
        "approximations of model.variant).", "list the structures in question; each costs one fit per fold.")] = ()
    # fmt: on

    def __post_init__(self) -> None:
        """Raise ValueError for a single fold, which leaves nothing to fit, and for repeated names."""
        if self.folds < 0 or self.folds == 1:
            raise ValueError(f"folds is {self.folds}; it must be at least 2, or 0 to leave out one at a time")
        check_different("variants:", [variant.name for variant in self.variants])
