"""Widgets that receive state and send messages; none holds an instrument or a store."""
