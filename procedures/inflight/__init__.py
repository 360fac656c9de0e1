"""Campaigns in orbit."""
