"""The engine: what is written in `hillsphere.symbolic`, compiled and propagated."""
