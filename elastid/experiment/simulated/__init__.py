"""The rig that is a model of the robot: what its controller, drives and sensors do."""
