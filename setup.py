# Copyright 2026 The smart_tire developers
#
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Build and install the package, with colcon (ament_python) or with pip."""

from glob import glob
import os
from pathlib import Path
from threading import Lock

from setuptools import Extension, find_packages, setup
from setuptools.command.build_ext import build_ext
from setuptools.errors import CompileError

PACKAGE = 'smart_tire'
NODES = [path.stem for path in sorted(Path(PACKAGE, 'nodes').glob('*.py'))
         if '\ndef main() -> int:' in path.read_text(encoding='utf-8')]
COMPILED = [str(path) for path in sorted(Path(PACKAGE).rglob('*.py'))
            if '\nCOMPILED: bool = cython.compiled\n' in path.read_text(encoding='utf-8')]
TYPES = [str(path) for path in sorted(Path(PACKAGE).rglob('*.pxd'))]  # what one takes of another


class BuildFromPython(build_ext):
    """
    Compile Python modules with Cython; they are installed as Python, too.

    Without Cython or a compiler, and if ``SMART_TIRE_NO_COMPILER`` is set, setuptools warns and
    installs the modules as Python only, because the extensions are optional.
    """

    _translation = Lock()  # Cython translates one module at a time, while others are compiled

    def finalize_options(self) -> None:
        """Use all cores."""
        super().finalize_options()
        self.parallel = self.parallel or os.cpu_count()

    def build_extension(self, ext: Extension) -> None:
        """Translate the module to C in the build folder, and compile that."""
        if os.environ.get('SMART_TIRE_NO_COMPILER'):
            raise CompileError('SMART_TIRE_NO_COMPILER is set')
        try:
            from Cython.Build import cythonize
            from Cython.Compiler.Errors import CompileError as TranslationError
        except ImportError as error:
            raise CompileError(f'no Cython: {error}') from error
        try:
            with self._translation:
                ext.sources = cythonize(ext, build_dir=self.build_temp, quiet=True)[0].sources
        except TranslationError as error:
            raise CompileError(f'Cython: {error}') from error
        super().build_extension(ext)


setup(
    name=PACKAGE,
    version='0.1.0',
    description='Slip, pose and tire-road friction of a skid-steer robot from films in its tires',
    license='Apache-2.0',
    maintainer='The smart_tire maintainers',
    maintainer_email='maintainers@smart-tire.example',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={PACKAGE: ['checks/findings.yaml', 'analysis/html_report/page.css',
                            'analysis/html_report/page.html', 'analysis/html_report/page.js',
                            'cli/verbs.yaml', 'fleet/columns.yaml', 'messages/topics.yaml',
                            'parameters/urdf_templates.yaml', 'papers/sections.yaml', 'py.typed',
                            *(path.removeprefix(f'{PACKAGE}/') for path in TYPES)]},
    ext_modules=[
        # without fused multiply-add, results are those of Python on every processor; with symbols
        # for debuggers the files are five times as large; what Cython writes leaves a tuple
        # uninitialized where it returns an error; without errno and traps of floating point, which
        # nothing reads, the same results are computed side by side
        Extension(path.removesuffix('.py').replace('/', '.'), [path], optional=True,
                  depends=TYPES,
                  extra_compile_args=['-ffp-contract=off', '-fno-math-errno', '-fno-trapping-math',
                                      '-g0', '-Wno-unused-variable',
                                      '-Wno-maybe-uninitialized'])
        for path in COMPILED],
    cmdclass={'build_ext': BuildFromPython},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'share/{PACKAGE}/launch', sorted(glob('launch/*.py'))),
        (f'share/{PACKAGE}/config', sorted(glob('config/*.yaml'))),
        (f'share/{PACKAGE}/config/calibration', sorted(glob('config/calibration/*'))),
        (f'share/{PACKAGE}/config/platforms', sorted(glob('config/platforms/*'))),
        (f'share/{PACKAGE}/config/view', sorted(glob('config/view/*'))),
        (f'share/{PACKAGE}/config/security', sorted(glob('config/security/*'))),
        (f'share/{PACKAGE}/urdf', sorted(glob('urdf/*.urdf'))),
    ],
    python_requires='>=3.10',
    install_requires=[
        'argcomplete', 'lz4', 'matplotlib', 'mcap>=1.6', 'numpy', 'plotly',
        'pyserial', 'pyyaml', 'rich', 'rosbags', 'scipy', 'zstandard',
    ],
    extras_require={
        # rclpy and the messages for machines without a ROS distribution
        'ros': [
            'ros-rclpy[fastrtps]', 'ros-builtin-interfaces', 'ros-diagnostic-msgs',
            'ros-geometry-msgs', 'ros-nav-msgs', 'ros-rcl-interfaces', 'ros-rosgraph-msgs',
            'ros-sensor-msgs', 'ros-std-msgs', 'ros-std-srvs',
        ],
        'view': ['rerun-sdk>=0.24'],  # smart_tire view
        'pandas': ['pandas'],         # results as data frames
        'parquet': ['pandas', 'pyarrow'],
        # many bags: URLs, data sets, clusters
        'fleet': ['aiohttp', 'distributed', 'fsspec', 'pyarrow', 's3fs'],
        'evo': ['evo; python_version >= "3.11"'],  # a test compares with it
        # smart_tire overhead; opencv from 4.12 on needs a newer numpy than ROS Jazzy has
        'camera': ['filterpy>=2.0', 'opencv-python-headless>=4.7,<4.12'],
        'docs': ['furo', 'ipykernel', 'latex2mathml', 'myst-nb', 'pandas', 'sphinx'],
        'test': [
            'duckdb', 'flask', 'flask-cors', 'hypothesis', 'moto[s3]', 'pandas', 'pytest',
            'pytest-cov', 'pytest-xdist', 'urdf-parser-py'],
        'lint': ['mypy==2.4.1', 'ruff==0.17.5'],
    },
    zip_safe=False,
    entry_points={
        'console_scripts': [
            *(f'{node} = {PACKAGE}.nodes.{node}:main' for node in NODES),
            f'{PACKAGE} = {PACKAGE}.cli.main:main',
        ],
        'ros2cli.command': [f'{PACKAGE} = {PACKAGE}.cli.main:SmartTireCommand'],
    },
)
