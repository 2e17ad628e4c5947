"""Long random checks, each a script: python -m tests.long.NAME"""
