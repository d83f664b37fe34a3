"""A recording whose streams share one clock: its rows are the log's."""

from massprop_cli.base.arrays import Array
from massprop_cli.inputs import columns
from massprop_cli.inputs.formats import resample, units
from massprop_cli.inputs.formats.mapfile import MappedWrench
from massprop_cli.inputs.formats.signals import QuantitySignal, Signals


def columns_of(signals: Signals) -> dict[str, Array]:
    """The log's columns by the contract's names."""
    said = signals.map
    imu = signals.imu()
    gyro = imu[0][0]
    for signal, _ in imu:
        _beside(gyro, signal, signals)
    made: dict[str, Array] = {columns.TIME: gyro.times.s} | signals.as_recorded(imu)
    attitude = None
    if said.attitude is not None:
        attitude = _beside(gyro, signals.attitude(said.attitude), signals).values
        made |= dict(zip(columns.QUATERNION, resample.z_up(attitude, said.attitude.world).T, strict=True))
    for key, wrench, known, names in wrenches(signals):
        values = _beside(gyro, signals.vector(key, wrench, known), signals).values
        if wrench.frame == "world" and attitude is not None:
            values = resample.into_body(values, attitude)
            signals.made.append(f"{key}: turned from world into body axes with the logged attitude of the same row")
        made |= dict(zip(names, values.T, strict=True))
    for name, jet in said.jets.items():
        on, share = signals.jet(name, jet)
        if share:
            raise signals.error(on.key, on.paths[0], "a valve's state wants control cycles to be summed over; state [records] in the map")
        made[columns.jet(name)] = _beside(gyro, on, signals).values[:, 0]
    for signal, column, _, _ in signals.spinners():
        made[column] = _beside(gyro, signal, signals).values[:, 0]
    return made


def wrenches(signals: Signals) -> list[tuple[str, MappedWrench, dict[str, float], tuple[str, ...]]]:
    """Commanded torque and force where the map has them: key, entry, units, columns."""
    said = signals.map
    both = (("torque", said.torque, units.TORQUE, columns.WRENCH[:3]), ("force", said.force, units.FORCE, columns.WRENCH[3:]))
    return [(key, wrench, known, names) for key, wrench, known, names in both if wrench is not None]


def _beside(gyro: QuantitySignal, signal: QuantitySignal, signals: Signals) -> QuantitySignal:
    """The signal, once it is seen to be on the gyro's clock."""
    own, its = signal.times, gyro.times
    if own is not its and (len(own.s) != len(its.s) or (own.s != its.s).any()):
        path = signal.paths[0] if signal.paths else ""
        raise signals.error(
            signal.key, path, f"its clock {own.path!r} is not the gyro's, {its.path!r}; state [records] in the map, onto which both are put"
        )
    return signal
