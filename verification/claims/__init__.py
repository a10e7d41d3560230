"""The claims of each study, one file a study, named as in ``workbench/studies/``."""
