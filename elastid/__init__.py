"""elastid: the elasticity of industrial robots, identified from frequency responses with honest intervals."""

__version__ = "0.1.0"
