"""Colours that colour-blind readers can distinguish (Okabe and Ito), for light and dark pages.

Figures also distinguish by line style, marker or label.
"""

PAPER, INK, MUTED, GRID, SHADE = "#ffffff", "#1b1f24", "#5b646e", "#d8dde3", "#eef1f4"
BLUE, ORANGE, GREEN, PURPLE, RED = "#0072b2", "#d55e00", "#00805e", "#a3507f", "#b3001b"

DARK = {
    PAPER: "#14181d", INK: "#e6edf3", MUTED: "#a3adb8", GRID: "#343b44", SHADE: "#1f252c",
    BLUE: "#62bdf0", ORANGE: "#ff9a5c", GREEN: "#3ed0a5", PURPLE: "#e8a3c9", RED: "#ff7a85",
}  # fmt: skip
"""Colour on a dark page, by colour on a light page."""
NAMES = {
    PAPER: "paper", INK: "ink", MUTED: "muted", GRID: "grid", SHADE: "shade",
    BLUE: "blue", ORANGE: "orange", GREEN: "green", PURPLE: "purple", RED: "red",
}  # fmt: skip
"""Name of each colour's CSS variable."""
VERDICT = {"converged": BLUE, "not_converged": ORANGE, "not_excited": PURPLE, "contradicted": RED, "unobservable": INK}
"""Line colour for each verdict."""


def css(dark: bool) -> str:
    """Definitions of the palette's CSS variables."""
    return " ".join(f"--{name}: {DARK[colour] if dark else colour};" for colour, name in NAMES.items())
