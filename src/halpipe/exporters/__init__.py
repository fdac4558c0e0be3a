"""Writers: a model or a schedule in, files out. They decide nothing."""
