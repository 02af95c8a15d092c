"""Use of a fitted robot where it was not measured: postures of paths and workspaces, maps of its stiffness, draws."""
