"""Figures as SVG of our own: drawn in milliseconds, with values to hover, and the same bytes for the same numbers.

What a figure calls is named as matplotlib names it, so that a reader of its code need not learn it anew; only what
our figures use is here. Lengths are points (1/72 inch); places on a page count from its upper left.
"""
