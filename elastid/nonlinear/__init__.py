r"""Nonlinear effects of gears and motors, estimated from multisine records and compensated in them.

.. math:: Y(k) = G(k)\, U(k) + \sum_i f_i\, H_i(k)\, \Phi_i(k)

Phi_i: spectrum of a known function of measured motions, at a place with the transfer H_i; f_i: its coefficient. Between
independent realisations G must be the same; the coefficients are those for which it is. Friction at the motors is the
case of Phi_i = phi(q, q') of a motor's angle, H_i = -G e_j: it is taken out of the torque, u_net = u - sum f_i phi_i.

Effects of gears are kinds of `basis_functions.GearEffect`; `gear_estimation` estimates them with the model parameters.
"""
