"""Which files of DIC systems are read? One reader a file."""
