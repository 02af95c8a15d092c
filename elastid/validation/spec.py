"""The sections `validation` and `compare` of a study."""

from __future__ import annotations

from elastid.base.names import Name, check_different
from elastid.base.section import section


@section
class ValidationSpec:
    """Configurations by which the model is judged.

    left_out: configurations that are not fitted. -- one where there are five or more, and not the most extreme one,
    which the others cannot speak for; none leaves residual tests on fitted data alone.
    folds: parts into which the other configurations are divided, each left out of one more fit; 0 for no
    cross-validation. -- 3 to 5 where parameters are to be compared between parts of the data; each costs a fit.
    """

    left_out: tuple[str, ...] = ()
    folds: int = 0

    def __post_init__(self) -> None:
        """Refuse repeated configurations, and one part, which leaves nothing to fit."""
        if self.folds < 0 or self.folds == 1:
            raise ValueError(f"folds is {self.folds}; it must be at least 2, or 0 for none")
        if len(set(self.left_out)) < len(self.left_out):
            raise ValueError(f"left_out repeats a configuration ({', '.join(self.left_out)})")


@section
class VariantSpec:
    """Another model for `elastid compare`: its differences from the study's own.

    name: of the model in the comparison. -- a few words that the table and the figures can hold.
    rigid: joints, and rods by the names of their loops, whose springs are left out; the gear of a driven joint is then
    rigid, any other joint is removed. -- the joint or rod whose elasticity is in doubt; a prediction that gets no worse
    says that the spring is not needed.
    motor_coupling: false neglects the motion of the rotors with their bodies. -- false for models of other tools that
    leave it out; with high ratios it matters in wrists most.
    set: keys of the study and their values as on the command line, such as model.formulation=serial or
    robot.gears.0.springs=before. -- for everything else, such as another band of the fit or other weights; one entry
    for each key.
    """

    name: Name
    rigid: tuple[str, ...] = ()
    motor_coupling: bool = True
    set: tuple[str, ...] = ()


@section
class CompareSpec:
    """The models that `elastid compare` fits and ranks.

    folds: parts into which the configurations are divided, each left out once; 0 leaves each configuration out alone.
    -- 4 or 5 where many configurations make leaving out one by one slow: every variant costs as many fits.
    variants: models beside the study's own (default: the robot without motor coupling, with the springs on the other
    side of coupled gears, and without each elastic joint that is not driven; a robot with loops also by its other exact
    formulation and by the approximations of model.variant, with the parameters that these lack fixed at their starts).
    -- a list of your own for the questions that are open; each costs a fit for each fold. A rigid loop and one constant
    stiffness predict alike where the stiffness of the gear is identified: it includes that of the rod.
    """

    folds: int = 0
    variants: tuple[VariantSpec, ...] = ()

    def __post_init__(self) -> None:
        """Refuse one part, which leaves nothing to fit, and repeated names."""
        if self.folds < 0 or self.folds == 1:
            raise ValueError(f"folds is {self.folds}; it must be at least 2, or 0 to leave out one at a time")
        check_different("variants:", [variant.name for variant in self.variants])
