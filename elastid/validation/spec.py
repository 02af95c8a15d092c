"""The sections `validation` and `compare` of a study."""

from typing import Annotated

from elastid.base.names import Name, check_different
from elastid.base.section import Key, section
from elastid.experiment.specs.experiment import ToolSpec


@section
class ValidationSpec:
    """Configurations, or logs of friction, by which the model is judged."""

    # fmt: off
    configurations: Annotated[tuple[str, ...], Key("Configurations that are not fitted; in a study of friction logs of "
        "motions, by the names of their files without extension.", "one where there are five or more, and not the most "
        "extreme one, which the others cannot predict; none leaves residual tests on fitted data alone.",
        distinct=True)] = ()
    tool: Annotated[ToolSpec | None, Key("Responses measured at the tool, which the fitted robot predicts.", "where "
        "the model is to say how the tool behaves: a few taps with a hammer show whether it does; taps under the "
        "section tool are fitted, too.")] = None
    # fmt: on


@section
class VariantSpec:
    """Another model for `elastid compare`: its differences from the study's own."""

    # fmt: off
    name: Annotated[Name, Key("Name of the model in the comparison.", "a few words that the table and the figures can "
        "hold.")]
    rigid: Annotated[tuple[str, ...], Key("Joints, and rods by the names of their loops, whose springs are left out; "
        "the gear of a driven joint is then rigid, any other joint is removed.", "the joint or rod whose elasticity is "
        "in doubt; a prediction that gets no worse says that the spring is not needed.")] = ()
    motor_coupling: Annotated[bool, Key("The rotors move with the bodies that carry them if true; false neglects that "
        "motion.", "false for models of other tools that leave it out; with high ratios it matters in wrists "
        "most.")] = True
    set: Annotated[tuple[str, ...], Key("Keys of the study and their values as on the command line, such as "
        "model.formulation=serial or robot.gears.0.springs=before.", "for everything else, such as another band of the "
        "fit or other weights; one entry for each key.")] = ()
    # fmt: on


@section
class CompareSpec:
    """The models that `elastid compare` fits and ranks."""

    # fmt: off
    folds: Annotated[int, Key("Number of parts into which the configurations are divided, each left out once; 0 leaves "
        "each configuration out alone.", "4 or 5 where many configurations make leaving out one by one slow: every "
        "variant costs as many fits.")] = 0
    variants: Annotated[tuple[VariantSpec, ...], Key("Models to compare with the study's own (default: the robot "
        "without motor coupling, and without each elastic joint that is not driven; a robot with loops also by its "
        "other exact formulation and by the approximations of model.variant, with the parameters that these lack fixed "
        "at their starts).", "a list of your own for the questions that are open; each costs a fit for each fold. A "
        "rigid loop and one constant stiffness predict the same where the stiffness of the gear is identified: it "
        "includes that of the rod.")] = ()
    # fmt: on

    def __post_init__(self) -> None:
        """Refuse one part, which leaves nothing to fit, and repeated names."""
        if self.folds < 0 or self.folds == 1:
            raise ValueError(f"folds is {self.folds}; it must be at least 2, or 0 to leave out one at a time")
        check_different("variants:", [variant.name for variant in self.variants])
