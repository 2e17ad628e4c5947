"""The operator by samples: a filter, onsets, steady inputs."""
