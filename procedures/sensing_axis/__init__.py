"""Campaigns on the turntable: the two-phase null search and its scans."""
