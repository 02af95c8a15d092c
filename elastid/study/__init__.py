"""Study: one YAML file and its robot file as a frozen value; every error has file, line and column.

The only room that knows YAML and pydantic.
"""

from elastid.study.loading import LoadedStudy, load, load_with_logs
from elastid.study.robots import load_robot
from elastid.study.sections import Study

load_study = load  # its public name, where it stands alone

__all__ = ["LoadedStudy", "Study", "load", "load_robot", "load_study", "load_with_logs"]
