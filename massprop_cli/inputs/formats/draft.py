"""Draft of a vehicle file from a log. Each line states its source; comments say how to measure values that no log gives."""

import json
from collections.abc import Mapping

import numpy as np

from massprop_cli.base.arrays import Array
from massprop_cli.inputs import columns
from massprop_cli.inputs.formats.traits import PRECISE, SETTLE, Traits, tick_s
from massprop_cli.inputs.formats.units import G

_AT_REST = "record ten seconds with the vehicle at rest and no command, or take the IMU's data sheet"
_GRAVITY, _NO_GRAVITY = 0.05, 0.1
"""Relative tolerance of gravity, and largest specific force without gravity as a fraction of gravity."""


def draft(name: str, found: Traits, parameters: Mapping[str, float], conversions: tuple[str, ...] = ()) -> str:
    """Text of a vehicle file; ``conversions`` are those by a map."""
    lines = ["schema = 1", f"name = {json.dumps(name)}   # of the file"]
    lines += [f"# map: {line}" for line in conversions]
    lines += ["", "[cycle]", *_cycle(found), "", "[imu]", *_imu(found), "", "[environment]", *_environment(found), "", *_commands(found)]
    lines += _px4(parameters)
    return "\n".join(lines) + "\n"


def _cycle(found: Traits) -> list[str]:
    steps = found.interval_s
    jitter = f"records come every {np.median(steps):.6g} s, from {steps.min():.6g} to {steps.max():.6g} s, jitter {steps.std():.3g} s rms"
    if found.records is None:
        lines = [
            f"# {jitter}; no command changes, so the log doesn't say how many are a control cycle",
            f"period_s = {found.period_s:.6g}   # one record",
        ]
    elif len(found.choices) > 1:
        own = " or ".join(f"{n * float(np.median(steps)):.6g} ({n})" for n in found.choices)
        lines = [
            f"# {jitter}",
            f'period_s = "?"   # {own} record(s), which the log can\'t show: on-times change at multiples of the last only,',
            "# and each counts once a control cycle, so that mass and inertia are proportional to it: ask who made the controller",
        ]
    else:
        only = (
            f"{found.records} record(s): commands change at multiples of that only" if found.issued_s is None else "from command to command"
        )
        lines = [f"# {jitter}", f"period_s = {found.period_s:.6g}   # {only}"]
    ticks = [tick for column, values in found.commands.items() if column.startswith("jet_") and (tick := tick_s(values)) is not None]
    if ticks:
        lines.append(f"pwm_tick_s = {min(ticks):.6g}   # all on-times are multiples of it")
    return [*lines, 'command_delay_cycles = "auto"   # found in the log by every estimate; state it once it is known']


def _imu(found: Traits) -> list[str]:
    lines = [
        "# position_m = [x, y, z]   # from O, body axes, m: measure it; left out, the IMU is taken to be at O",
        "# body_from_imu = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]   # by rows: pitch, roll and yaw the vehicle by hand and see which axis turns",
    ]
    how = f"by second differences over {found.quiet} quiet cycles (no command for {SETTLE} before)"
    for key, noise in (("gyro_noise_rad_s", found.gyro_noise), ("accel_noise_m_s2", found.accel_noise)):
        if noise is None:
            lines.append(f"# {key} = ...   # too few quiet cycles: left out, it is estimated from the log; to measure it, {_AT_REST}")
            continue
        axes = ", ".join(f"{value:.2g}" for value in noise)
        line = f"{key} = {float(np.sqrt((noise**2).mean())):.3g}   # one sigma of a cycle's mean {how}; by axis {axes}"
        unsure = "too few to state" if found.quiet < PRECISE else "of the shortest cycle that it may be" if len(found.choices) > 1 else ""
        lines.append(f"# {line}: {unsure}, so it is estimated from the log; to measure it, {_AT_REST}" if unsure else line)
    if found.gyro_mean is not None:
        mean = ", ".join(f"{value:.3g}" for value in found.gyro_mean)
        lines.append(
            f"# gyro_bias_sigma_rad_s = {float(np.abs(found.gyro_mean).max()):.2g}   # if the vehicle was at rest in the quiet cycles: "
            f"their mean rate is {mean} rad/s; if it drifted, record it at rest"
        )
    else:
        lines.append(f"# gyro_bias_sigma_rad_s = ...   # left out, no bias is supposed: {_AT_REST}")
    lines.append("# accel_bias_sigma_m_s2 = ...   # turn the vehicle over at rest: half the difference of what each axis feels up and down")
    for key, clipped in (("gyro_range_rad_s", found.gyro_clipped), ("accel_range_m_s2", found.accel_clipped)):
        unknown = f"# {key} = ...   # data sheet; the log reaches no limit"
        lines.append(unknown if clipped is None else f"{key} = {clipped:.9g}   # several records stand at just this, the largest")
    return lines


def _environment(found: Traits) -> list[str]:
    if found.force_m_s2 is None:
        why = f"it feels {found.force_always_m_s2:.4g} m/s^2 under commands, which gravity and thrust do alike"
    elif abs(found.force_m_s2 / G - 1) < _GRAVITY:
        return [
            f"# in {found.quiet} quiet cycles the accelerometer feels {found.force_m_s2:.4g} m/s^2: something holds it. State what:",
            '# kind = "air_bearing"   # it turns about a fixed point',
            '# kind = "pedestal"      # the same on a bearing that is fixed to the ground',
            '# kind = "planar"        # it slides and yaws on a table: the accelerometer feels the same there',
            "# (if it only stands on the ground there, cut that off with [[phases]], and state the kind of the rest)",
            "# bearing_position_m = [x, y, z]   # the centre of rotation from O: the bearing's drawing",
            "# bearing_mass_kg = ...            # what slides with the vehicle and does not turn: weigh it",
            "# initial_attitude_wxyz = [1, 0, 0, 0]   # level at the start, or from an inclinometer",
        ]
    elif found.force_m_s2 < _NO_GRAVITY * G:
        return [f'kind = "free"   # in {found.quiet} quiet cycles the accelerometer feels {found.force_m_s2:.3g} m/s^2: no gravity']
    else:
        felt = f"{found.force_m_s2:.4g} m/s^2"
        why = f"in {found.quiet} quiet cycles the accelerometer feels {felt}, neither gravity nor none: is its unit right?"
    return [f'# kind = "free"   # or "air_bearing": {why}; left out, it is free']


def _span(values: Array) -> str:
    """Range and number of distinct values of a command."""
    known = values[np.isfinite(values)]
    span = f"{known.min():.4g} to {known.max():.4g}" if known.size else "nothing"
    return f"{span}, {len(np.unique(known))} different values in {len(known)} cycles"


def _commands(found: Traits) -> list[str]:
    lines = []
    for column, values in found.commands.items():
        if any(kind.named(column) for kind in found.actuators):
            continue
        known = values[np.isfinite(values)]
        if column in columns.WRENCH:
            lines.append(f"# {column}: {_span(values)}")
            continue
        on = known[known > 0]
        span = f"on in {len(on)} of {len(known)} cycles, {on.min():.4g} to {on.max():.4g} s" if len(on) else "never on in this log"
        lines += [
            "[[jets]]",
            f"name = {json.dumps(column.removeprefix('jet_').removesuffix('_s'), ensure_ascii=False)}   # column {column}: {span}",
            "# position_m = [x, y, z]   # of the nozzle from O, body axes, m: drawing or ruler",
            "# force_n = [x, y, z]      # on the vehicle at full thrust, N: press on a scale, or mass flow times exhaust speed",
            "# rise_s = ...             # and fall_s: a force or pressure sensor; left out, at once",
            "",
        ]
    for kind, own in found.actuators.items():
        for name, has in own.items():
            logged = found.commands.get(has.of(name))
            lines += kind.draft(name, has, "" if logged is None else _span(logged))
    thrust = [
        "[thrust]",
        "# scale_sigma = 0.05   # how well the forces above are known, all together: mass and inertia are proportional to them",
        '# lag_s = "auto"       # if thrust follows commands through a first-order lag, as a rotor does',
        "# nominal_pa = ...     # of jets whose supply pressure is logged (supply_pa): the absolute pressure that force_n holds for",
    ]
    if not found.commands and not any(own for kind, own in found.actuators.items() if kind.THRUSTS):
        return lines or ["# no column of commands: jet_NAME_s, rotor_NAME_command, cmd_torque_x_n_m or wheel_NAME_rad_s"]
    return [*lines, *([""] * (lines[-1:] != [""])), *thrust]


def _px4(parameters: Mapping[str, float]) -> list[str]:
    """Rotors or thrusters of PX4's control allocation (CA_ROTORi_*), in PX4's body axes forward, right, down, as comments."""
    count = round(parameters.get("CA_ROTOR_COUNT", 0))
    if not 0 < count <= 64:
        return []
    lines = ["", "# from the recording's own parameters (PX4 control allocation; axes forward, right, down from its centre):"]
    for n in range(count):
        defaults = {"PX": 0.0, "PY": 0.0, "PZ": 0.0, "AX": 0.0, "AY": 0.0, "AZ": -1.0, "CT": 6.5, "KM": 0.05}
        px, py, pz, ax, ay, az, ct, km = (parameters.get(f"CA_ROTOR{n}_{part}", value) for part, value in defaults.items())
        size = float(np.sqrt(ax * ax + ay * ay + az * az)) or 1.0
        force = ", ".join(f"{ct * axis / size:.6g}" for axis in (ax, ay, az))
        place = f"position_m = [{px:.6g}, {py:.6g}, {pz:.6g}], force_n = [{force}]"
        lines.append(f"# CA_ROTOR{n}: {place} at full (CT = {ct:.6g}), torque ratio KM = {km:.6g} m")
    return [*lines, "# CT is what the controller reckons with, not what was measured: press each on a scale"]
