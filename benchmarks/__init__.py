"""Side by side with peers, as ratios: `python -m benchmarks [TOPIC …]`.

A topic is a module here with TITLE, PACKAGES (distributions whose versions the table names) and jobs(quick), which
yields `benchmarks.harness.Job`s. See benchmarks/robots.py.
"""
