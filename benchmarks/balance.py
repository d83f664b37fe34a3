"""Random tables on a pedestal: log, estimate, move the ballast as massprop balance says, log again.

    python benchmarks/balance.py --tables 50

Half of the tables turn by jets, half by wheels. Ballasts weigh other than stated (0.05 %, one sigma) and are set wrongly (0.02 mm, one
sigma), which is stated. Printed: what truly remains against what is wanted and its stated sigma, and the check of the second log.
"""

import sys
from pathlib import Path

import numpy as np
from scores import covered, rms_of
from script import counted

sys.path.insert(0, str(Path(__file__).parents[1]))
from massprop_cli.balance.document import G_CM
from massprop_cli.base.arrays import Array
from tests import anypedestal, balanced

OFFSET_M = 1e-3
"""One sigma of each level component of the CG's distance from the pivot."""


def main() -> None:
    """Run all tables and print the figures."""
    count = counted(__doc__, tables=50).parse_args().tables
    parts = [ran(*one) for one in (("jets", 1, count - count // 2), ("wheels", 2, count // 2))]
    first, rest, z, second, p, masses, reached = (np.concatenate(part) for part in zip(*parts, strict=True))
    print("| | |")
    print("|---|--:|")
    print(f"| tables, of which the ballasts reach the wanted first moment | {len(first)}, {reached.sum()} |")
    print(f"| first moment before, median [g cm] | {G_CM * np.median(first):.0f} |")
    print(f"| true distance from the wanted first moment, median [g cm] | {G_CM * np.median(rest):.2f} |")
    print(f"| ... of the first moment before: median, worst | {100 * np.median(rest / first):.2f} %, {100 * np.max(rest / first):.2f} % |")
    print(f"| ... within its stated 95 % interval; rms in sigmas | {_share(z)} |")
    print(f"| first moment by both logs and the moves, the same | {_share(second)} |")
    print(f"| refined masses of moved ballasts, the same | {_share(masses)} |")
    print(f"| p of the check below 0.05, below 0.001 | {(p < 0.05).sum()}, {(p < 0.001).sum()} |")


def _share(z: Array) -> str:
    return f"{covered(z)}; {rms_of(z)}"


def ran(kind: anypedestal.Kind, seed: int, count: int) -> tuple[Array, ...]:
    """Of each table: size before, true distance from what is wanted, deviates of remainder, of κ, p, deviates of masses, reached."""
    rng = np.random.default_rng(seed)
    own = anypedestal.tables(rng, count, OFFSET_M)
    held = balanced.weights(rng, own)
    logs = balanced.results(rng, own, kind)
    found = balanced.balances(logs, held)
    new = balanced.put(rng, own, held, balanced.changes(found))
    checked = balanced.balances(logs, held, balanced.results(rng, new, kind))
    (left, sigma), (now, spread), true = balanced.moment(found, "remainder"), balanced.moment(checked, "now"), balanced.moments(new)
    wanted = np.array([one.plan.wanted.kg_m for one in found])
    off = [
        (mass.refined_kg - held.mass[v]["xyz".index(mass.name)]) / mass.refined_sigma_kg
        for v, one in enumerate(checked)
        for mass in (one.check.masses if one.check else [])
        if mass.name != "tray"
    ]
    p = np.array([one.check.p for one in checked if one.check])
    size = np.linalg.norm(balanced.moments(own), axis=1)
    off_by, reached = np.linalg.norm(true - wanted, axis=1), np.array([one.plan.reached for one in found])
    return size, off_by, ((true - left) / sigma).ravel(), ((now - true) / spread).ravel(), p, np.array(off), reached


if __name__ == "__main__":
    main()
