"""The use cases: upload, train, recognise, generate, evaluate, promote."""
