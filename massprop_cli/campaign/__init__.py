"""Many logs: a plan of jobs, each worked into a result folder of its own, then tables and statistics of them all.

::

    discover ─ Job ─ runner (work, in parallel) ─ Produced ─ Place ─ Outcome ─ summary, pool ─ campaign.json, campaign.parquet, page

``work`` is a pure function of one job, ``run`` composes the flow; ``remote`` (stores) and ``cluster`` are optional extras.
"""
