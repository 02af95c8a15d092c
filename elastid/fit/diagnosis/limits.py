"""Thresholds of the diagnosis."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """Thresholds of the diagnosis, far above the values of correct models (scripts/studies/results.csv).

    Measured there: V 1.13 of its expectation, disagreement of blocks 1.4; of 330 true models none reached a drop of
    20; a missing spring lowers V by 44 to 87 where V shows nothing (5 % of noise).
    false_alarm_rate: Bonferroni over all candidates, not a false discovery rate: a single false cause in a report is
    one too many, and their drops are strongly correlated.
    """

    # A misfit, as `status` has it.
    excess: float = 1.2
    disagreement: float = 1.5
    structure: float = 1.3
    shift: float = 2.0  # standard deviations
    drop: float = 30.0
    prior: float = 4.0  # standard deviations of a prior or tolerance by which the data may move its number
    prior_fraction: float = 0.8  # that the data leave, at most, to contradict a prior
    effect: float = 0.005  # of a parameter, below which a change is a note and no misfit, and has no words
    effect_on_damping: float = 0.05  # likewise of a damping or a friction
    # An estimate.
    residual_ratio: float = 5.0  # of a configuration to the median of all, beyond which it is unlike the others
    factor_spread: float = 2.5  # of (2 pi)^2 by which all stiffnesses are off where the unit of the frequency is wrong
    stiffness_std: float = 0.5  # the largest, of ln p: beyond it a parameter, or a prior of one, is weak
    # Shares of the excess of V that a cause explains.
    min_further_fraction: float = 0.05  # that each in a sequence explains
    min_stated_fraction: float = 0.1  # below which a cause has no sentence, and a delay no other form
    min_cause_fraction: float = 0.3  # below which even the best is not named as the reason, nor a load sought
    majority_fraction: float = 0.5  # of a variant, of a cause of contradictions; of the responses that a model explains
    sufficient_fraction: float = 0.8  # of a reading; from which on no cause is sought that V does not rank
    certain_fraction: float = 0.9  # below which a cause is said not to be certain, and springs are sought; of responses
    # that a model explains: below which, where the noise is unknown, they may have been misread
    complete_fraction: float = 0.99  # below which scales and variants are tried, too
    # The ranking of causes.
    false_alarm_rate: float = 0.01  # probability that any candidate has so large a drop by the noise alone
    linear_error: float = 0.002  # of the excess that the true cause explains, error of one linear step
    equal_correlation: float = 0.95  # squared, from which two candidates cannot be distinguished
    equal_drop: float = 0.9  # ratio of their drops, likewise, or of V of two readings or variants
    equal_odds: float = 6.0  # 2 ln of the odds (20 to 1) below which two causes cannot be told apart
    variances: float = 10.0  # difference of V, in variances of the noise, below which there is no minimum, no best form
    alone: int = 15  # in the table
    ranked: int = 25  # judged by their forms
    named: int = 3  # parameters, postures, or causes besides, in a sentence
    # The searches.
    exchanged: int = 8  # configurations that fit worst, which are tried in each other's place
    refits: int = 3  # causes in a sequence; readings, springs and delays, by which the search goes on
    predicted_ratio: float = 1.5  # V over that of the fit up to which readings and springs are followed
    frequency_step: float = math.sqrt(2.0)  # ratio of neighbouring resonances of a spring
    stiffnesses: int = 14  # of each spring
    scale: float = 1.7  # a factor nearer to one may be an inertia that is not quite known
    scale_rounds: int = 2  # in which scales and parameters are found in turn
    edge_phase: float = 0.8  # f T at the upper edge of the longest lateness that is sought
    residuals: int = 2_000  # of the fit of a variant
    iterations: int = 15  # of the solver with a reading, a spring, a load or a second source, of the search for T
    rounds: int = 4  # of linearisations, in which a load is found
    load_radius: float = 0.1  # of gyration of a load at the start, m
    load_std: float = 1.0  # of the logarithms of its mass and inertia about the start, and of its place in m
    # A second source.
    unreached: float = 30.0  # std of x in a direction that the motors' responses do not reach
    largest: float = 0.9  # factor less 1, beyond which another channel interpretation is the cause


LIMITS = Limits()
