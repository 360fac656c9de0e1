"""Recordings as files: bundles read, checked and written, HDF5, what is saved from damaged stores."""
