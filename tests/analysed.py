"""Sample logs estimated once for all tests that look at the same result."""

from functools import cache
from pathlib import Path

from massprop_cli import job
from massprop_cli.flow import Analysis

SAMPLES = Path(__file__).parents[1] / "sample_logs"


@cache
def analysed(name: str, method: str = "default") -> Analysis:
    """What is found in a sample log."""
    return job.of_file(SAMPLES / name / "log.parquet", assignments=(f"estimator.method={method}",)).analysis
