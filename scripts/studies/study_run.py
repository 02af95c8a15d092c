"""Set-up of a study script: one BLAS thread, the path to the plants of the tests, and command-line options.

Scripts import this module first, because NumPy reads the number of threads when it is loaded.
"""

import os
import sys
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from pathlib import Path
from typing import Any

os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))


def options(doc: str, quick: str, **defaults: Any) -> Namespace:
    """Parse the command line: --quick, and an option for each keyword argument.

    quick: help text of --quick.  defaults: value of each option, which also defines its type. A list accepts one or
    more values, a tuple one or more of its own values; False is a flag, and a type is an option without a default.
    """
    parser = ArgumentParser(description=doc, formatter_class=RawDescriptionHelpFormatter)
    for name, default in {"quick": False, **defaults}.items():
        keys: dict[str, Any] = {"default": default, "type": type(default)}
        if default is False:
            keys = {"action": "store_true"}
        elif isinstance(default, type):
            keys = {"type": default}
        elif isinstance(default, list | tuple):
            choices = default if isinstance(default, tuple) else None
            keys |= {"type": type(default[0]), "nargs": "+", "choices": choices}
        parser.add_argument(f"--{name}", help=quick if name == "quick" else None, **keys)
    return parser.parse_args()
