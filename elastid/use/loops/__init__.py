"""Control loops of the identified robot: plants, sensitivities, margins, gains, and what records show of them."""
