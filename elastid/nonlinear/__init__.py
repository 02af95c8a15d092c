r"""Nonlinear effects of gears and motors, estimated from multisine records and compensated in them.

.. math:: Y(k) = G(k)\, U(k) + \sum_i f_i\, H_i(k)\, \Phi_i(k)

Phi_i: spectrum of a known function of measured signals; H_i: FRF from its location to the outputs; f_i: coefficient.
The coefficients are estimated so that G is equal in all independent realisations. Friction of motor j is the case
Phi_i = phi(q_j, q_j'), H_i = -G e_j: it is compensated in the torque, u_net = u - sum f_i phi_i.

Effects of gears are kinds of `basis_functions.GearEffect`; `gear_estimation` estimates them with the model parameters.
"""
