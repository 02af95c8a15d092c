# ruff: noqa: I001
"""The public names for editors and type checkers, as `elastid._HOMES` has them."""

from elastid import plot as plot
from elastid.robot import Robot as Robot, Body as Body, Joint as Joint, Spring as Spring, Motor as Motor
from elastid.record import Record as Record, Configuration as Configuration
from elastid.response import Response as Response
from elastid.parameters import Parameters as Parameters
from elastid.fit.result import Result as Result
from elastid.api import (
    read_robot as read_robot,
    read_records as read_records,
    simulate as simulate,
    choose as choose,
    estimate as estimate,
    identify as identify,
    load as load,
    save as save,
)
from elastid.app.finished_run import run as run, export as export, compare as compare

__version__: str
