"""What claims are judged by, computed without judging: trajectories, the three PPDs, lifted maps, sweeps."""
