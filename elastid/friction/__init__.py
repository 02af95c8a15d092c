r"""Friction models: static models, dynamic models with states, and their use at motors and joints of a robot.

In a frequency response: about a sliding speed v_0 > 0 a LuGre law is, to first order,

.. math:: \frac{d\tau}{dv} = \alpha_2 + (\sigma_0 + \sigma_1 s) \frac{b}{s + \sigma_0 v_0 / g(v_0)}, \qquad
          b = \frac{v_0 g'(v_0)}{g(v_0)}

and b vanishes above three to five nu_s: only the viscous alpha_2 remains, which the linear model has. At rest the law
is a spring sigma_0 to ground, indistinguishable from stiffness of the robot; near nu_s it is negative damping. So
experiments keep the joints sliding (`experiment.simulated.carrier`). Dry friction that reverses under a multisine adds
damping, and a distortion that averages out over realisations (`design.predicted_response`).
"""
