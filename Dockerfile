# unlit with its models: `docker build -t unlit .`, then
# `docker run --rm -v "$PWD/out:/out" unlit` reconstructs the demo's photo into out/.
FROM python:3.11-slim

# The sources that the wheel is built from.
WORKDIR /src
COPY pyproject.toml hatch_build.py README.md LICENSE NOTICE ./
COPY viewer viewer
COPY src src
RUN pip install --no-cache-dir . && rm -rf /src/*

# Not root; the models are fetched once, into the image.
RUN useradd --create-home face && install -d -o face /out
USER face
RUN unlit models fetch

WORKDIR /out
ENTRYPOINT ["unlit"]
CMD ["demo", "-o", "/out/demo"]
