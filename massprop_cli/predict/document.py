"""What ``massprop predict --json`` prints: the models below are the schema (``massprop schema predict``)."""

from typing import Literal

from pydantic import Field

from massprop_cli.result.schema import Item


class PredictionSource(Item):
    """A result, or a log."""

    path: str
    phase: str
    input_sha256: list[str] = Field(description="of the log, or of all logs of a joint result")
    vehicle_sha256: str


class PredictionTest(Item):
    """The likelihood-ratio test of the log's motion under the result's values with their covariance."""

    chi_square: float
    freedom: int = Field(description="directions that both show by more than what they share")
    p: float = Field(description="chance of as large a difference where both are of one body")
    limit: float = Field(description="confidence level: it passes where p is above 1 - limit")
    passes: bool


class PredictedQuantity(Item):
    """One quantity by the result and by the log; null where either gives no value."""

    unit: str
    result: float | None
    result_sigma: float | None
    log: float | None
    log_sigma: float | None
    difference: float | None = Field(description="result less log")
    difference_sigma: float | None = Field(description="of the difference, without what both share")


class Explained(Item):
    """How given values explain the motion of a channel."""

    percent: float | None = Field(description="of the motion's mean square; below 0 where the values make it worse; null without motion")
    residual_rms: float = Field(description="measured less predicted, in the channel's unit")
    expected_rms: float = Field(description="of the residual by the log's noise and disturbances alone, values taken as exact")
    mean_square: float = Field(description="of normalised innovations, values taken as exact; 1 is expected of the log's own values")


class MotionItem(Item):
    """One channel in one manoeuvre."""

    channel: str = Field(description="rate_x ... specific_force_z, body axes")
    manoeuvre: str = Field(description='cycles in which this axis is commanded most (torque_x ... force_z), "rest" or "all"')
    unit: str
    cycles: int
    motion_rms: float = Field(description="of the motion without its unknown beginnings, in the unit")
    result: Explained = Field(description="by the result's values")
    log: Explained = Field(description="by the log's own values, for comparison")


class Prediction(Item):
    """The whole of what ``massprop predict --json`` prints."""

    schema_: Literal["massprop/predict/1"] = Field("massprop/predict/1", alias="schema")
    vehicle: str
    result: PredictionSource
    log: PredictionSource
    test: PredictionTest
    quantities: dict[str, PredictedQuantity] = Field(description="the ten, on a fixed pedestal the nine about the pivot")
    motion: list[MotionItem] = Field(description="by channel and manoeuvre; empty where either gives no body")
