"""The sections `validation` and `compare` of a study."""

from __future__ import annotations

from elastid.base.section import section


@section
class ValidationSpec:
    """On what the model is judged.

    left_out: configurations that the fit does not see.  folds: parts into which the other configurations are divided,
    each left out of one more fit; 0 for none.
    """

    left_out: tuple[str, ...] = ()
    folds: int = 0

    def __post_init__(self) -> None:
        """Refuse a configuration that is named twice, and one part, which leaves nothing to fit."""
        if self.folds < 0 or self.folds == 1:
            raise ValueError(f"folds is {self.folds}; it must be at least 2, or 0 for none")
        if len(set(self.left_out)) < len(self.left_out):
            raise ValueError(f"left_out names a configuration twice ({', '.join(self.left_out)})")


@section
class VariantSpec:
    """Another model for `elastid compare`, as far as it differs from the study's own.

    name: of the model in the comparison.
    rigid: joints and rods, these by the names of their loops, whose springs are left out; the gear of a driven joint is
    then rigid, and any other joint is not there.  motor_coupling: false has every rotor turn about its own axis only.
    set: keys of the study and their values as on the command line, such as model.formulation=serial or
    robot.gears.0.springs=before.
    """

    name: str
    rigid: tuple[str, ...] = ()
    motor_coupling: bool = True
    set: tuple[str, ...] = ()


@section
class CompareSpec:
    """Which models `elastid compare` holds against each other.

    folds: parts into which the configurations are divided, each left out once; 0 leaves each configuration out alone.
    variants: default the robot without motor coupling, with the springs on the other side of coupled gears, and without
    each elastic joint that is not driven; a robot with loops also by its other exact formulation and by the
    approximations of model.variant, what these do not know held at its start. A rigid loop and one constant stiffness
    then predict alike where the gear's stiffness is identified: it takes the rod's share.
    """

    folds: int = 0
    variants: tuple[VariantSpec, ...] = ()

    def __post_init__(self) -> None:
        """Refuse one part, which leaves nothing to fit, and names given twice."""
        if self.folds < 0 or self.folds == 1:
            raise ValueError(f"folds is {self.folds}; it must be at least 2, or 0 to leave out one at a time")
        names = [variant.name for variant in self.variants]
        if len(set(names)) < len(names):
            raise ValueError(f"variants names one twice ({', '.join(names)})")
