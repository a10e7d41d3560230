"""Studies that come with the workbench, one folder a paper."""
