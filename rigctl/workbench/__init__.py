"""Where a model fails, which known effect is missing, how sure that is, and what to measure next.

Nothing here knows an experiment: each describes itself to the workbench as a `rigctl.workbench.study.Study`.
"""
