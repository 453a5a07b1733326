"""A central planner for all robots: priority inheritance over sequences of motions."""

from train.epibt.planner import NAME, NEEDS, SUMMARY, Epibt, check_config

__all__ = ["NAME", "NEEDS", "SUMMARY", "Epibt", "check_config"]
