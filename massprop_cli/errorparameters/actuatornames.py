"""What findings call the actuators that they are about."""

from collections.abc import Mapping

from massprop_cli.errorparameters.parameter import FittedHypothesis
from massprop_cli.inputs.vehicle import ACTUATORS

NEAR = 0.05
"""Parts of the stated thrust within which a jet is dead or reversed: a sixth of the prior sigma of a jet that is neither."""
KEYS = {"rotors": "thrust_n", "wheels": "spin_inertia_kg_m2", "control_moment_gyros": "h_n_m_s or spin_inertia_kg_m2"}
"""What says how strong each is."""


def table_of(finding: FittedHypothesis) -> str:
    """The table of the vehicle file in which the channels stand that it is about; empty: a wrench's components."""
    return finding.tables[finding.channel]


def nouns(finding: FittedHypothesis) -> tuple[str, str]:
    """One and many of them, each with a space; empty of a wrench's components."""
    table = table_of(finding)
    one = {"jets": "jet"} | {name: kind.NOUN for name, kind in ACTUATORS.items()}
    return (f"{one[table]} ", f"{one[table]}s ") if table else ("", "")


def entries(finding: FittedHypothesis) -> list[str]:
    """Names of the actuators that it is about, in place of those of their axes."""
    by_axis = table_of(finding) == "control_moment_gyros"
    return list(dict.fromkeys(name.rpartition(" ")[0] if by_axis else name for name in finding.subject))


def who(finding: FittedHypothesis) -> Mapping[str, object]:
    """The actuators of a finding and how much of what is stated they do, with verbs that agree."""
    named, table, (one, many) = entries(finding), table_of(finding), nouns(finding)
    several, listed = len(named) > 1, ", ".join(named)
    scale = "correct the unit or scale of these, or of the others, under [columns]" if several else "correct the scale under [columns]"
    verbs = {verb: verb if several else f"{verb}{'es' if verb in ('push', 'do') else 's'}" for verb in ("push", "give", "do", "turn")}
    if table not in ("", "jets", "rotors"):
        verbs["push"] = "turn the vehicle" if several else "turns the vehicle"
    turned = "" if abs(finding.factor + 1) < NEAR else f", at {-finding.factor:.3g} of the stated thrust"
    return {
        "who": f"{many if several else one}{listed}",
        "factor": finding.factor,
        "turned": turned,
        "of": "momentum" if table not in ("", "jets", "rotors") else "thrust",
        "scale": {"jets": "correct force_n, or calibrate the thrust", "": scale}.get(
            table, f"correct {KEYS.get(table, '')}, calibrate it, or check the unit of its column"
        ),
        "key": KEYS.get(table, ""),
        **verbs,
    }
