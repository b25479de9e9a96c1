"""The history of the tables, for alembic; ``Database.migrate`` applies it."""
