"""The simulated rig: a model of the robot with its controller, drives, friction and sensors."""
