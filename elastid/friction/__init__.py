r"""Friction laws: static ones, and dynamic ones with states.

- law:      the contract, and the curve g(v) of sliding friction that all laws share
- static:   Coulomb and Tustin (Stribeck), smoothed at standstill; viscous friction is not here, it is linear
- dynamic:  Dahl, LuGre, generalised Maxwell slip
- placed:   the friction of a robot: laws at its motors and joints, on the link side, under load and temperature

What a frequency response sees of it. About a sliding speed v_0 > 0 a LuGre law is, to first order,

.. math:: \frac{d\tau}{dv} = \alpha_2 + (\sigma_0 + \sigma_1 s) \frac{b}{s + \sigma_0 v_0 / g(v_0)}, \qquad
          b = \frac{v_0 g'(v_0)}{g(v_0)}

and b vanishes above three to five nu_s: there only the viscous alpha_2 is left, which is what the linear model has. At
rest the law is a spring sigma_0 to ground, which looks like stiffness of the robot; near nu_s it is negative damping.
So experiments keep the joints sliding (`experiment.simulated.carrier`). What dry friction still does, reversing under a
multisine, is some damping more and a distortion that averages over realisations (`experiment.design.friction_level`).
"""
