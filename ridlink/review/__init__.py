"""Recorded traffic, looked at afterwards: who met whom, and what other definitions would have said.

source    the Remote ID of recordings, and the telemetry of vehicles, in the order of time
own       who is best known by its telemetry
walk      frames to scenes, on the recording's own clock
approach  how near every pair came between two scenes
report    encounters as rows, and the worst of them with all that is drawn
traces    tracks and distances of an encounter in bounded memory
drawing, pictures, page
          the report as one HTML page
whatif    what other definitions would have said
"""

from ridlink.review.report import Report
from ridlink.review.source import Source, together
from ridlink.review.walk import Walk

__all__ = ["Report", "Source", "Walk", "together"]
