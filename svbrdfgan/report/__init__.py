"""What a run leaves for people to look at: one self-contained HTML page, and one picture."""

from svbrdfgan.report.hero import write_hero
from svbrdfgan.report.page import write_report

__all__ = ["write_hero", "write_report"]
