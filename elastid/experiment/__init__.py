"""Where, how often and on what the excitation runs: the plan, and the rigs that carry it out."""
