"""Every cause that can be named, one file each."""
