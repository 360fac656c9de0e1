"""SCPI and IEEE 488.2 as an instrument hears them: the grammar, and the shell around a simulated device."""

from simulators.scpi.commands import Command, Pending, Register, Reply, resting, setting
from simulators.scpi.device import ScpiShell
from simulators.scpi.grammar import Boolean, Choice, Integer, Number, OnOffOnce, ScpiError, Text, header_regex, parse

__all__ = [
    "Boolean",
    "Choice",
    "Command",
    "Integer",
    "Number",
    "OnOffOnce",
    "Pending",
    "Register",
    "Reply",
    "ScpiError",
    "ScpiShell",
    "Text",
    "header_regex",
    "parse",
    "resting",
    "setting",
]
