"""The page with its explorer of responses and its mode viewer."""
