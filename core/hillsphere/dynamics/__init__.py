"""The engine: what is written in `hillsphere.symbolic`, compiled and propagated."""

from hillsphere.dynamics.compiled import ArrayFunction

__all__ = ["ArrayFunction"]
