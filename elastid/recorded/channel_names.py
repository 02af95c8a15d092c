"""Channels as a study states them against their names, and against each other: no samples are needed for that."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from elastid.base.units import TABLE
from elastid.experiment.specs.channels import MOTIONS, QUANTITY_UNIT, ChannelSpec
from elastid.recorded.channel_guess import DRIVES, guess_by_name


@dataclass(frozen=True)
class Doubt:
    """A doubt about a channel, by its place in the study's list, None for the rate of all; key: that is at fault."""

    channel: int | None
    key: str
    text: str


def doubts_by_names(channels: Sequence[ChannelSpec]) -> Iterator[Doubt]:
    """One signal as torque and motion, torques and motions that are exchanged, and units unlike all others."""
    yield from _twice(channels)
    yield from _by_names(channels)
    yield from _of_a_family(channels)


def _twice(channels: Sequence[ChannelSpec]) -> Iterator[Doubt]:
    """One signal of the file that is a torque and a motion."""
    for i, channel in enumerate(channels):
        for other in channels[:i]:
            is_one = (channel.file, channel.channel, channel.column) == (other.file, other.channel, other.column)
            if is_one and channel.is_motion != other.is_motion and "t" not in (channel.role, other.role):
                text = f"{channel.name_in_file} is the {other.quantity} at {other.at}, and cannot be the"
                key = "channel" if channel.channel else "column"
                yield Doubt(i, key, f"{text} {channel.quantity} at {channel.at}, too")


def _by_names(channels: Sequence[ChannelSpec]) -> Iterator[Doubt]:
    """A torque and a motion that are called as each other, and units that headings state otherwise."""
    guesses = [guess_by_name(c.channel, None) for c in channels]
    is_word = [bool(re.search(r"[a-z]{2}", c.channel, re.IGNORECASE)) for c in channels]
    drives = [g for g, c, known in zip(guesses, channels, is_word, strict=True) if known and g.quantity in DRIVES]
    of_motions = [g for g in drives if any(c.role == "y" and c.channel == g.name for c in channels)]
    for i, (channel, guess) in enumerate(zip(channels, guesses, strict=True)):
        if channel.role == "u" and is_word[i] and guess.quantity in MOTIONS and of_motions:
            text = f"{guess.name} is a {guess.quantity} by its name, and {of_motions[0].name}, stated as a motion, a"
            yield Doubt(i, "channel", f"{text} {of_motions[0].quantity}: exchange them")
        stated = TABLE.get(channel.unit or QUANTITY_UNIT[channel.quantity])
        in_brackets = re.search(r"[\[(][^\])]+[\])]\s*$", channel.channel) is not None and guess.unit in TABLE
        is_other = stated != TABLE.get(guess.unit) and channel.scale == 1 == guess.scale
        if in_brackets and channel.role == "y" and guess.quantity in MOTIONS and is_other:
            key = "unit" if guess.quantity == channel.quantity else "quantity"
            text = f"the heading {guess.name} says {guess.quantity} in {guess.unit}"
            yield Doubt(
                i, key, f"{text}, and not {channel.quantity} in {channel.unit or QUANTITY_UNIT[channel.quantity]}"
            )


def _of_a_family(channels: Sequence[ChannelSpec]) -> Iterator[Doubt]:
    """The one of several signals, whose names differ by a number alone, that is stated in another unit than all."""
    families: dict[tuple[str, str], list[int]] = {}
    for i, channel in enumerate(channels):
        if re.search(r"\d", channel.channel) and not re.fullmatch(r"column \d+", channel.channel):
            families.setdefault((re.sub(r"\d+", "#", channel.channel), channel.quantity), []).append(i)
    for (_, quantity), members in families.items():
        sizes = [TABLE.get(channels[i].unit or QUANTITY_UNIT[quantity], ("", 1.0)) for i in members]
        for place, i in enumerate(members):
            others = sizes[:place] + sizes[place + 1 :]
            if (
                len(others) > 1
                and len(set(others)) == 1
                and sizes[place] != others[0]
                and sizes[place][0] == others[0][0]
            ):
                other = channels[members[0 if place else 1]]
                stated, usual = (c.unit or QUANTITY_UNIT[quantity] for c in (channels[i], other))
                text = (
                    f"{channels[i].name_in_file} is stated in {stated}, {other.name_in_file} and the others in {usual}"
                )
                yield Doubt(i, "unit", f"{text}; a log has one unit for all joints")
