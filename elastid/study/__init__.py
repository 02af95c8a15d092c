"""Study: one YAML file and its robot's file as a frozen value, every error with file, line and column.

The only room that knows YAML and pydantic.

- source:       text -> plain data and the place of every key
- sections:     Study and FleetSpec, which gather the sections that live in the rooms that use them
- reference:    every key with its places, its type in words and its text; schema for editors, `elastid explain`
- messages:     plain data -> a section, or one readable sentence for each error
- checks:       contradictions between sections
- robots:       a robot's file in any of its forms -> Robot, and back
- loading:      file -> Study in SI, overrides of the command line included
- fleet:        a fleet's file -> its members
"""

from elastid.study.loading import LoadedStudy, load
from elastid.study.reference import SCHEMA_NAME, make_schema
from elastid.study.robots import load_robot
from elastid.study.sections import Study

load_study = load  # its public name, where it stands alone

__all__ = ["SCHEMA_NAME", "LoadedStudy", "Study", "load", "load_robot", "load_study", "make_schema"]
