"""Many logs: a plan of jobs, each worked into a result folder of its own, then tables and statistics of them all.

::

    discover ─ Job ─ runner (work, in parallel) ─ Produced ─ Place ─ Outcome ─ summary, pool ─ campaign.json, campaign.parquet, page

:mod:`massprop_cli.campaign.work` is a pure function of one job, ``runner`` decides where and when it runs, ``place`` where its files go;
:mod:`massprop_cli.campaign.run` composes them.

Logs and results may be on a store (``location``, ``remote``, ``urlplace``), and jobs on a cluster (``cluster``); both are optional
extras, imported where they are asked for.
"""
