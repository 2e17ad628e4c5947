"""The operator by integrals: free runs, features, evaluation of a window."""
