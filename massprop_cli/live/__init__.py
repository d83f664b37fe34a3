"""Estimation of a live stream: massprop reads, stores and processes each record before it waits for the next one."""
