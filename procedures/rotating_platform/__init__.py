"""Campaigns on the rotating platform."""
