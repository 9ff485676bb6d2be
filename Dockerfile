# flexmbd with DOLFINx 0.9, on Debian 13. Untried: no image could be fetched; tools/try_wheel.py has hadolint read it.
#
#     docker build -t flexmbd .
#     docker run --rm -it -v "$PWD:/work" flexmbd python /flexmbd/demos/slider_crank.py

FROM debian:trixie

# Debian 13 holds its versions by itself.
# hadolint ignore=DL3008
RUN apt-get update \
    && DEBIAN_FRONTEND=noninteractive apt-get install --yes --no-install-recommends \
        python3-dolfinx python3-dolfinx-real python3-petsc4py-real python3-slepc4py-real python3-mpi4py \
        python3-gmsh python3-numba python3-scipy python3-matplotlib python3-h5py \
        python3-venv python3-pip gcc g++ libopenblas0-pthread openmpi-bin ca-certificates git \
        libgl1 libegl1 libglu1-mesa libxrender1 libxcursor1 libxft2 libxinerama1 \
    && rm -rf /var/lib/apt/lists/*

# One thread a process; Open MPI as root, on any number of ranks, without the network; VTK without a screen.
ENV PATH=/opt/venv/bin:$PATH \
    OMP_NUM_THREADS=1 \
    OMPI_ALLOW_RUN_AS_ROOT=1 \
    OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 \
    OMPI_MCA_btl=^tcp \
    PRTE_MCA_rmaps_default_mapping_policy=:oversubscribe \
    PRTE_MCA_hwloc_default_binding_policy=none \
    PYVISTA_OFF_SCREEN=true \
    VTK_DEFAULT_OPENGL_WINDOW=vtkEGLRenderWindow

COPY . /flexmbd
RUN python3 -m venv --system-site-packages /opt/venv \
    && pip install --no-cache-dir --editable "/flexmbd[test]"

WORKDIR /work
CMD ["bash"]
