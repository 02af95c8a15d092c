"""Local polynomial and local rational methods: responses from fewer experiments than inputs, transients removed."""
