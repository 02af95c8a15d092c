"""Names that are code, markup or a value somewhere else, and a study all of whose names are such."""

from elastid.robot import Body, Frame, Joint, Motor, Placement, Robot, Spring

# Admitted: of each program that reads what a study writes, what its own language is made of.
HOSTILE = (
    "it's", 'say "x"', "a\\b", "tail\\", "x*/ #error pwn", "/* x", "??/", "// x", "100 %", "%s %n", "$x^{$", "$(id)",
    "{x}", "{{ 7*7 }}", "{% x %}", "<script>alert(1)</script>",
    "</script><blink>", "<!-- x", "--", "]]>", "&amp;", "a & b",
    "a;b", "# x", "größe θ₁", "ציר ראשון", "轴一", "🤖", "axis [1]", "k_*",
    "axis - 1", "n" * 100, "__proto__", "_x",
    "yes", "1", "null", "~", "- a", "a: b", "!!python/object", "&anchor", "*alias", "|", "<<", "2026-01-01", "1e3",
    "=1+1", "+1", "[red]x[/]",
    "[/]", ":smile:", "int", "return 0", "-1", "../x", "a/b", "C:\\x", "a.b", "world", "x`y",
)  # fmt: skip

# Those among them that can name a file, and with it a configuration or a study.
FILES = tuple(name for name in HOSTILE if not any(c in '/\\:*?"<>|' for c in name) and name[0] != "." != name[-1])

# Refused: not one line of printable characters, or not a name.
REFUSED = (
    "", " x", "x ", "a\nb", "1\nevil: 1", "x*\\\n/ \n#error pwn\n/*", "a\tb", "a\rb", "\x1b[31mred", "a\x07b", "a\x7fb",
    "a\x9bb", "\u202egnp.exe", "a\u2066b", "a\u200bb", "\ufeffa", "a\u2028b", "a\u00a0b", "a\0b", "n" * 101, "a@b",
)  # fmt: skip


def picked(names: tuple[str, ...], start: int, count: int) -> list[str]:
    """So many of the names from a place on, round in a circle."""
    return [names[(start + i) % len(names)] for i in range(count)]


def hostile_robot(start: int) -> Robot:
    """Two axes whose joints, bodies, frame and the robot itself have names from a place of HOSTILE on."""
    first, second, upper, fore, frame, robot = picked(HOSTILE, start, 6)
    joints = [
        Joint(name, axis, Spring(2e4, 15.0), Motor(1e-3, 100, 1e-3), viscous=0.1)
        for name, axis in ((first, "z"), (second, "y"))
    ]
    bodies = (
        Body(upper, joints=(joints[0],), mass=10, center_of_mass=(0.1, 0, 0.2), inertia=0.3),
        Body(fore, upper, Placement((0, 0, 0.5)), (joints[1],), 5, (0.2, 0, 0), 0.1),
    )
    return Robot(robot, bodies, frames=(Frame(frame, fore, Placement((0.4, 0, 0))),), source="a\n# free\x1b[31m text")
