"""Results made by hand, whose every number a test can know."""

from pathlib import Path
from typing import Any

from massprop_cli import QUANTITIES, UNITS
from massprop_cli.conclude.reason import Reason
from massprop_cli.result.read import Recorded
from massprop_cli.result.schema import Result

VALUES = dict(zip(QUANTITIES, (0.62, 0.04, -0.07, 2.8, 0.11, 2.5, -0.018, 0.027, 0.012, 22.0), strict=True))
SIGMAS = dict(zip(QUANTITIES, (0.01, 0.002, 0.003, 0.02, 0.004, 0.03, 0.001, 0.002, 0.003, 0.25), strict=True))


def estimates(**changes: dict[str, Any]) -> dict[str, Any]:
    """Ten converged estimates, with changes quantity by quantity."""
    base = {"verdict": "converged", "final_at_s": 12.5, "reason": "informed, and within tolerance"}
    return {
        name: {"value": VALUES[name], "sigma": SIGMAS[name], "unit": UNITS[name], **base, **changes.get(name, {})} for name in QUANTITIES
    }


def phase(name: str = "all", **changes: dict[str, Any]) -> dict[str, Any]:
    return {
        "name": name,
        "start_s": 0.0,
        "end_s": 60.0,
        "estimates": estimates(**changes),
        "covariance": [[0.0] * 10] * 10,
        "inertia_about_origin": None,
        "physical": {"consistent": True, "principal_moments": [0.6, 2.5, 2.8], "note": ""},
        "innovations": None,
    }


def docked(**changes: dict[str, Any]) -> dict[str, Any]:
    return {"before": "single", "after": "combined", "estimates": estimates(**changes), "covariance": [[0.0] * 10] * 10}


def result(phases: list[dict[str, Any]] | None = None, **changes: Any) -> Result:
    """A result of one phase "all", unless told otherwise; further keys replace those of result.json."""
    data: dict[str, Any] = {
        "schema": "massprop/result/1",
        "provenance": {
            "massprop": "0.1.0",
            "input_sha256": "a" * 64,
            "vehicle_sha256": "b" * 64,
            "settings": {"estimator.method": "default"},
            "versions": {"python": "3.11.0", "numpy": "2.0.0"},
        },
        "vehicle": {
            "name": "tug",
            "environment": "free",
            "bearing_mass_kg": 0.0,
            "bearing_position_m": [0.0, 0.0, 0.0],
            "commands": "jets",
            "jets": ["roll_p1"],
            "thrust_scale_sigma": 0.0,
        },
        "log": {"path": "log.parquet", "rows": 1200, "cycles": 1200, "duration_s": 60.0, "cycle_s": 0.05},
        "delay": {"cycles": 2.0, "source": "vehicle", "detected_cycles": None, "sigma_cycles": None},
        "lag": {"lag_s": 0.0, "source": "vehicle", "sigma_s": None},
        "conventions": {"inertia_about": "cg", "products_of_inertia": "tensor"},
        "phases": phases or [phase()],
        "docked_object": None,
        "warnings": [],
    }
    return Result.model_validate(data | changes)


def recorded(found: Result | None = None, folder: str = "run") -> Recorded:
    """The same as read from a folder."""
    return Recorded(Path("/results") / folder / "result.json", found or result(), {})


CAUSE = "jet roll_p1 pushes the other way (jet-sign)"


def contradicted(name: str = "all", **changes: Any) -> dict[str, Any]:
    """A phase whose log contradicts the vehicle file: all quantities but ``izz``, not excited, ``cg_x``, not converged, and ``cg_y``,
    unobservable."""
    wrong: dict[str, dict[str, Any]] = {
        quantity: {"verdict": "contradicted", "final_at_s": None, "reason": CAUSE} for quantity in QUANTITIES
    }
    wrong["ixx"] |= {"value": -825.1234567, "sigma": 4.0}
    hardly = Reason.of("hardly-informed", wants="torque about Z")
    wrong["izz"] |= {"verdict": "not_excited", "reason": str(hardly), "reason_code": hardly.code}
    wrong["cg_x"] |= {"verdict": "not_converged", "reason": "it still moved more than the tolerance"}
    wrong["cg_y"] |= {"verdict": "unobservable", "value": None, "sigma": None, "reason": "no motion of this vehicle can inform it"}
    return phase(name, **wrong) | {"contradiction": CAUSE} | changes


def mended(contradiction: str = "", **changes: dict[str, Any]) -> dict[str, Any]:
    """What the log gives with the jet's sign turned."""
    kept = ("value", "sigma", "unit", "verdict")
    told = {name: {key: item[key] for key in kept} for name, item in estimates(**changes).items()}
    settings = ["jets.roll_p1.force_n=[0.0, 0.0, -1.112]", "cycle.command_delay_cycles=2.0"]
    phases = [{"name": "all", "estimates": told, "contradiction": contradiction}]
    return {"code": "jet-sign", "message": "With jet roll_p1 turned round", "settings": settings, "phases": phases}


def assumptions(*phases: str) -> list[dict[str, Any]]:
    """Three: one that the log can't tell, one that it hardly could, one that it would."""
    scaled = {name: VALUES[name] / 100 for name in QUANTITIES if not name.startswith("cg")}
    steps = (
        ("thrust-scale", "All thrust is as the vehicle file states it", "1 %", scaled, None, True),
        ("imu-position", "The IMU is where the vehicle file says", "1 mm", {"cg_x": -0.000996, "mass": 123.4}, 2.12, True),
        ("pulse-shape", "Thrust rises at once", "1 ms", {"ixx": 0.0}, 12.3, False),
    )
    return [
        {
            "code": code,
            "message": message,
            "step": step,
            "stated": stated,
            "effects": [{"phase": phase, "change": change, "seen_sigma": seen} for phase in phases or ("all",)],
        }
        for code, message, step, change, seen, stated in steps
    ]
