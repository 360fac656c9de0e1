"""A store as a file of HDF5 by the conventions of NeXus."""
