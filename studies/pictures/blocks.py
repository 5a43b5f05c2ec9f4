"""The loop in six blocks: what a controller is made of, for a first look."""

from dataclasses import dataclass
from xml.sax.saxutils import escape

from glassgait.models.task.palette import GROUND, INK

WIDTH, HEIGHT = 840, 392
BOX_WIDTH, BOX_HEIGHT = 228, 118
LEFT, GAP, TOP, BOTTOM = 40, 38, 28, 246
BUS = 192
"""Height at which what is known is gathered for those that act."""

SOFT, LINE = "#555f6b", "#555f6b"
KNOWING, ACTING, MOVING = ("#e7f1f9", "#0072b2"), ("#fdeee0", "#c75300"), ("#eceff2", "#555f6b")
"""Ground and edge of blocks that know, that act, and that are moved; the words differ as well."""


@dataclass(frozen=True)
class Block:
    """A block.

    Attributes:
        title: Its name.
        words: What it does, a line each.
        column: Its column, from the left.
        row: Its row, from the top.
        look: Ground and edge.
    """

    title: str
    words: tuple[str, ...]
    column: int
    row: int
    look: tuple[str, str]

    @property
    def left(self) -> int:
        """Left edge."""
        return LEFT + self.column * (BOX_WIDTH + GAP)

    @property
    def top(self) -> int:
        """Upper edge."""
        return (TOP, BOTTOM)[self.row]

    @property
    def middle(self) -> int:
        """Middle, from the left."""
        return self.left + BOX_WIDTH // 2


_WORDS = (
    ("Sensors", "IMU, 12 joints, 4 feet;|a stuck contact sensor|is not believed", 0, 0, KNOWING),
    ("Odometry", "the trunk's speed and|each foot's height,|by ten statements", 1, 0, KNOWING),
    ("Reward machine", "in which state the gait|is, by contacts and|heights of the feet", 2, 0,
     KNOWING),
    ("Formulas", "a target for each joint;|or a network, trees or|an additive model", 2, 1, ACTING),
    ("Limits", "targets in range, near|to the joints, within|what motors can do", 1, 1, ACTING),
    ("Robot", "joints go to targets: in|Drake, in MuJoCo, or by|LCM or DDS messages", 0, 1, MOVING),
)  # fmt: skip
"""Title and words of each block, its column and row, and its look.

A line has 24 characters at most, which a block has room for.
"""

BLOCKS = tuple(
    Block(title, tuple(words.split("|")), column, row, look)
    for title, words, column, row, look in _WORDS
)

DESCRIPTION = (
    "Six blocks in a loop: sensors, odometry and the reward machine know; formulas and limits act, "
    "by all that is known; the robot moves, and is sensed again."
)


def blocks_svg() -> str:
    """Draws the loop in six blocks, on a ground of its own, so that it is read on any page."""
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" '
        f'font-family="system-ui, Segoe UI, Helvetica, DejaVu Sans, sans-serif">',
        f"<title>{escape(DESCRIPTION)}</title>",
        '<defs><marker id="end" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="8" '
        f'markerHeight="8" orient="auto"><path d="M0 0L10 5L0 10z" fill="{LINE}"/></marker></defs>',
        f'<rect x="1" y="1" width="{WIDTH - 2}" height="{HEIGHT - 2}" rx="14" fill="{GROUND}" '
        'stroke="#c9d0d8"/>',
        *_arrows(),
        *(part for number, block in enumerate(BLOCKS, start=1) for part in _drawn(number, block)),
    ]
    return "\n".join([*parts, "</svg>"]) + "\n"


def _arrows() -> list[str]:
    sensors, odometry, machine, policy, limits, robot = BLOCKS
    across, below = TOP + BOX_HEIGHT // 2, BOTTOM + BOX_HEIGHT // 2
    return [
        _arrow((sensors.left + BOX_WIDTH, across), (odometry.left, across)),
        _arrow((odometry.left + BOX_WIDTH, across), (machine.left, across)),
        *(
            _line((block.middle, TOP + BOX_HEIGHT), (block.middle, BUS))
            for block in (sensors, odometry, machine)
        ),
        _line((sensors.middle, BUS), (policy.middle, BUS)),
        _arrow((policy.middle, BUS), (policy.middle, BOTTOM)),
        _arrow((limits.middle, BUS), (limits.middle, BOTTOM)),
        _arrow((policy.left, below), (limits.left + BOX_WIDTH, below)),
        _arrow((limits.left, below), (robot.left + BOX_WIDTH, below)),
        # Back to the sensors, outside of what is known.
        f'<path d="M{robot.left} {below}H{LEFT - 18}V{across}H{sensors.left}" fill="none" '
        f'stroke="{LINE}" stroke-width="2" marker-end="url(#end)"/>',
        _words((sensors.middle + 12, BUS - 9), "all that is known, every 20 ms", "start"),
        _arrow((WIDTH - 14, BUS), (policy.middle + 2, BUS)),
        _words((WIDTH - 16, BUS - 9), "commands", "end"),
    ]


def _drawn(number: int, block: Block) -> list[str]:
    ground, edge = block.look
    return [
        f'<rect x="{block.left}" y="{block.top}" width="{BOX_WIDTH}" height="{BOX_HEIGHT}" rx="10" '
        f'fill="{ground}" stroke="{edge}" stroke-width="2"/>',
        f'<text x="{block.left + 15}" y="{block.top + 32}" font-size="19" font-weight="600" '
        f'fill="{INK}">{number}. {escape(block.title)}</text>',
        *(
            f'<text x="{block.left + 15}" y="{block.top + 58 + 20 * line}" font-size="15" '
            f'fill="{INK}">{escape(words)}</text>'
            for line, words in enumerate(block.words)
        ),
    ]


def _line(start: tuple[int, int], end: tuple[int, int], more: str = "") -> str:
    return (
        f'<path d="M{start[0]} {start[1]}L{end[0]} {end[1]}" stroke="{LINE}" '
        f'stroke-width="2"{more}/>'
    )


def _arrow(start: tuple[int, int], end: tuple[int, int]) -> str:
    return _line(start, end, ' marker-end="url(#end)"')


def _words(at: tuple[int, int], words: str, anchor: str) -> str:
    return (
        f'<text x="{at[0]}" y="{at[1]}" font-size="14" text-anchor="{anchor}" '
        f'fill="{SOFT}">{escape(words)}</text>'
    )
