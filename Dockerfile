FROM python:3.11-slim AS build
RUN python -m venv /opt/gesta
ENV PATH=/opt/gesta/bin:$PATH PIP_NO_CACHE_DIR=1 PIP_DISABLE_PIP_VERSION_CHECK=1
WORKDIR /src
# Without the code this installs only what Gesta depends on: a layer that lasts as long as pyproject.toml.
COPY pyproject.toml README.md LICENSE ./
RUN pip install .
COPY app app
COPY migrations migrations
RUN pip install --no-deps --force-reinstall .

FROM python:3.11-slim
# What the kernels are compiled for. Another processor than the builder's finds them compiled only if the
# features, too, are fixed: those of CPU and no more. `--build-arg CPU=generic` fits every machine.
ARG CPU=x86-64-v3
ENV PATH=/opt/gesta/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    NUMBA_CACHE_DIR=/var/cache/gesta \
    NUMBA_CPU_NAME=$CPU \
    NUMBA_CPU_FEATURES=""
COPY --from=build /opt/gesta /opt/gesta
RUN useradd --uid 10001 --home-dir /var/lib/gesta --no-create-home --shell /usr/sbin/nologin gesta \
    && install --directory --owner gesta --group gesta /var/lib/gesta /var/cache/gesta
USER 10001:10001
RUN gesta warm
# The default database and store lie in the working directory.
WORKDIR /var/lib/gesta
VOLUME /var/lib/gesta
EXPOSE 8000
STOPSIGNAL SIGTERM
HEALTHCHECK --interval=10s --timeout=5s --start-period=60s \
    CMD ["python", "-c", "import http.client as h; c = h.HTTPConnection('127.0.0.1', 8000, timeout=4); \
c.request('GET', '/readyz'); exit(c.getresponse().status != 200)"]
ENTRYPOINT ["gesta"]
CMD ["serve", "--host", "0.0.0.0"]
