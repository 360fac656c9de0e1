"""`rigctl check`: the first day's guide through a rig's instruments, and the record of it that `run` asks for."""
