"""Follows a joint's friction with a Kalman filter, from the motor's angle and torque."""
