"""A page in the browser on which a problem's numbers are changed and its observer is seen."""
