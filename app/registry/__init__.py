"""The durable truth: models, demonstrations, versions, aliases, jobs, sessions, and the store of artifacts."""
