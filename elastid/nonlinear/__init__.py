r"""Friction at the motors, found in the records of a frequency response and taken out of their torque.

.. math:: u_{net} = u - \sum_i f_i \phi_i(q, \dot q), \qquad Y = G\, U_{net}

q: measured angle of the motor.  Between independent realisations G must be the same; the levels f_i are those for which
it is.

- find:         all of it, from the records of a measurement
- motion:       angle and velocity of a motor between its samples
- operators:    bristles along a motion, means over its cells
- shapes:       phi_i, and their spectra
- candidates:   which shapes are tried, and when none can be found
- limits:       motors that stick, motors and torques that friction is not found of
- spectra:      torques, motions and shapes of all experiments of a configuration
- levels:       f_i by regression, with covariance
- selection:    which of the shapes, by cross-validation over realisations
- alternatives: which others fit nearly as well, and what the choice adds to the covariance
- choice:       both for all motors, rates of bristles among them
- reversals:    motion of a motor with what its samples do not show, under the friction that was found
- accelerance:  of the motors as inertias, above the excited lines
- net_torque:   record -> record whose u is the net torque
- result:       what was found and taken out
- bias:         what friction that is left does to G beyond viscous friction
"""
