"""Batch estimation of many logs: one job and one result folder per log, then tables and statistics of all logs.

::

    discover ─ Job ─ runner (work, in parallel) ─ Produced ─ Place ─ Outcome ─ summary, pool ─ campaign.json, campaign.parquet, page

``work`` is a pure function of one job, and ``run`` composes the flow. ``remote`` (object stores) and ``cluster`` are optional extras.
"""
