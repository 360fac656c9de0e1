"""The catalogue of physical effects: small functions, each what one piece of physics adds to the chain."""

from rigctl.effects.catalogue import Effect, catalogue, effect

__all__ = ["Effect", "catalogue", "effect"]
