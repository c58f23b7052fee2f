# Headstock in a container of its own; elsewhere ./headstock needs none.
#
#   docker build -t headstock .
#   docker run --rm --user "$(id -u):$(id -g)" -v "$PWD:/work" -w /work headstock run scene.toml
FROM debian:13
COPY environment/packages.txt /tmp/packages.txt
RUN apt-get update \
    && grep -v -e '^#' -e '^$' /tmp/packages.txt | xargs apt-get install -y --no-install-recommends \
    && rm -rf /var/lib/apt/lists/* /tmp/packages.txt
COPY . /opt/headstock
# bytecode beforehand, because an ordinary user may not write there
RUN useradd --create-home somebody && chmod -R a+rX /opt/headstock && python3 -m compileall -q /opt/headstock
USER somebody
ENTRYPOINT ["/opt/headstock/headstock"]
CMD ["--help"]
