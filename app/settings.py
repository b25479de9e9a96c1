"""Settings of a Gesta process: the environment (``GESTA_…``), read here and nowhere else."""

from __future__ import annotations

from datetime import timedelta
from typing import Literal

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict


class Settings(BaseSettings):
    """Where things are kept and how much is allowed; each field is the variable ``GESTA_<FIELD>``."""

    model_config = SettingsConfigDict(env_prefix="GESTA_", frozen=True)

    database_url: str = Field(
        "sqlite:///gesta.db", description="`sqlite:///PATH` or `postgresql://USER:PASSWORD@HOST/NAME`."
    )
    store_url: str = Field(
        "models_store",
        description="Where artifacts and demonstrations are: a directory or `s3://BUCKET/PREFIX`.",
    )
    host: str = Field("127.0.0.1", description="Address to listen on.")
    port: int = Field(8000, ge=0, le=65535, description="Port to listen on; 0: any that is free.")
    workers: int = Field(1, ge=1, le=256, description="Server processes that listen there.")
    job_worker: Literal["embedded", "none"] = Field(
        "embedded",
        description="`embedded`: `gesta serve` starts the worker process; `none`: it runs elsewhere.",
    )
    session_retention: timedelta = Field(
        timedelta(days=7),
        description="How long the frames of a finished session are kept, in ISO 8601.",
    )
    max_body_bytes: int = Field(
        64 << 20, gt=0, description="Largest request body; a larger one is answered with 413."
    )
