"""Files an operator writes: rig and campaign files, read strictly."""
