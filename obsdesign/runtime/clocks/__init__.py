"""Clocks at run time: time stamps, steps of discrete time, dwell times, events and sensors."""
