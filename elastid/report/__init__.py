"""Report of a study: contents, answers in words, figures and the HTML page."""
