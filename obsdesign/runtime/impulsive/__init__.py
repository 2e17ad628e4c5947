"""The impulsive observer at run time: a window of impulses."""
