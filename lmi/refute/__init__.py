"""Witnesses against stability and against common certificates, checked."""
