"""Wire logs: every byte to and from an instrument in a file, and drivers run against such a file."""
