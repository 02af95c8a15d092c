"""What a study and the results of earlier runs tell the design."""

from __future__ import annotations

from elastid.base.errors import StudyError
from elastid.design.problem import DesignProblem
from elastid.response import FrequencyResponse
from elastid.store import read_fit, read_responses
from elastid.study import LoadedStudy
from elastid.study.checks.design import responses_file


def brief_of(loaded: LoadedStudy) -> DesignProblem:
    """The study's sections, with the responses and the estimates of the earlier measurements that it names.

    Where several measurements were fitted, the last one's estimate counts.  DataError for a file that cannot be read.
    """
    study = loaded.study
    if study.excitation is None:
        raise StudyError(f"{loaded.path}: excitation: this section is needed to design an experiment")
    measured: list[FrequencyResponse] = []
    found: dict[str, float] = {}
    like: tuple[FrequencyResponse, ...] = ()
    if study.design is not None:
        for path in study.design.measured:
            file = responses_file(loaded.base, path)
            measured += read_responses(file)
            estimate = file.with_name("fit.h5")
            if estimate.is_file():
                result = read_fit(estimate)
                found |= {name: result.values[name] for name in result.parameters.free_names}
        if study.design.noise.frf:
            like = read_responses(responses_file(loaded.base, study.design.noise.frf))
    return DesignProblem(
        robot=study.robot,
        excitation=study.excitation,
        experiment=study.experiment,
        fit=study.fit,
        quantity=study.estimator.quantity,
        seed=study.seed,
        design=study.design,
        left_out=study.validation.left_out,
        measured=tuple(measured),
        found=tuple(found.items()),
        like=like,
        model=study.model,
    )
