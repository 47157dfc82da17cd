"""The engine: one own-ship and its goal, datagrams in, setpoints out, without input or output of its own."""

from ridlink.engine.config import EngineConfig, Goal
from ridlink.engine.core import Engine
from ridlink.engine.decision import Conflict, DecisionRecord, EngineSummary, StepOutput

__all__ = ["Conflict", "DecisionRecord", "Engine", "EngineConfig", "EngineSummary", "Goal", "StepOutput"]
