"""Thresholds of the diagnosis."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """Thresholds of the diagnosis, far above the values of correct models (scripts/studies/results.csv).

    Largest values of 330 correct models: V 1.13 times its expectation, disagreement of blocks 1.4, drop of V 20.
    Freeing a missing spring lowers V by 44 to 87 even if the residual test passes (5 % of noise). false_alarm_rate:
    Bonferroni correction over all candidates instead of a false discovery rate, because a report must not contain a
    single false cause, and the drops of the candidates are strongly correlated.
    """

    # Status `misfit`.
    excess: float = 1.2
    disagreement: float = 1.5
    structure: float = 1.3
    min_shift: float = 2.0  # standard deviations
    min_drop: float = 30.0
    max_prior_stds: float = 4.0  # standard deviations of a prior or tolerance by which the data may move its number
    prior_fraction: float = 0.8  # largest posterior over prior variance of a parameter that can contradict its prior
    effect: float = 0.005  # relative change of a parameter, below which it is no misfit and is not reported
    effect_on_damping: float = 0.05  # relative change of a damping or friction, likewise
    # Notes on estimates.
    residual_ratio: float = 5.0  # residuals of an inconsistent configuration over the median of all configurations
    factor_spread: float = 2.5  # ratio to (2 pi)^2, the error of all stiffnesses by a wrong unit of the frequency
    stiffness_std: float = 0.5  # std of ln p, above which a parameter or a prior is weak
    # Fractions of the excess of V that a cause explains.
    min_further_fraction: float = 0.05  # least for a further cause in a sequence
    min_stated_fraction: float = 0.1  # least for a cause in a sentence, and for the search of a delay's form
    min_cause_fraction: float = 0.3  # least for the best cause to be named, and for the search of a load
    majority_fraction: float = 0.5  # least for an alternative model or a contradiction; least of explained responses
    sufficient_fraction: float = 0.8  # least for a channel hypothesis; above, the search for unranked causes ends
    certain_fraction: float = 0.9  # least for a likely cause; below, it is a possible cause, and springs are tested;
    # also least fraction of explained responses without known noise, below which channel hypotheses are tested
    complete_fraction: float = 0.99  # below, scales and alternative models are also tested
    # Ranking of causes.
    false_alarm_rate: float = 0.01  # probability that noise alone makes the drop of any candidate significant
    linear_error: float = 0.002  # error of one linear step, relative to the excess of V
    equal_correlation: float = 0.95  # squared correlation above which two candidates are indistinguishable
    equal_drop: float = 0.9  # ratio of their drops, or of V of two channel hypotheses or models, likewise
    equal_odds: float = 6.0  # 2 ln of the odds (20 to 1) below which two causes are indistinguishable
    cost_margin: float = 10.0  # least difference of V, in variances of the noise, of a minimum or of a best form
    n_single_causes: int = 15  # single causes in the table
    n_ranked: int = 25  # ranked causes
    n_named: int = 3  # parameters, configurations or further causes in a sentence
    # Searches.
    n_exchange_candidates: int = 8  # configurations with the largest residuals, of which pairs are exchanged
    n_refits: int = 3  # causes in a sequence; channel hypotheses, springs and delays that are refitted
    predicted_ratio: float = 1.5  # largest predicted V over V of the fit for a refit of channels, springs or robots
    frequency_step: float = math.sqrt(2.0)  # ratio of neighbouring resonances of a spring
    n_stiffnesses: int = 14  # largest number of trial stiffnesses of a spring
    min_scale: float = 1.7  # least factor of a wrong unit; a smaller factor can be an error of an inertia
    n_scale_rounds: int = 2  # alternations between estimation of scales and of parameters
    edge_phase: float = 0.8  # largest trial delay T times the highest frequency of the band
    n_refit_residuals: int = 2_000  # largest number of residuals in a refit
    iterations: int = 15  # of the solver in a refit, and of the search for a delay
    n_load_rounds: int = 4  # linearisations in the search for a load
    load_radius: float = 0.1  # start value of a load's radius of gyration, m
    load_std: float = 1.0  # prior std of the logarithms of its mass and inertia, and of its position in m
    # Static load tests and tool responses.
    unidentifiable_std: float = 30.0  # std of x in a direction that is not identifiable from the motors' responses
    min_channel_factor_error: float = 0.9  # |factor - 1| above which a wrong channel interpretation is the cause


LIMITS = Limits()
