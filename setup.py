"""Installs the ament_python package `svdm_ros`; name, version and people come from package.xml."""
from glob import glob
from xml.etree import ElementTree

from setuptools import find_packages, setup

manifest = ElementTree.parse('package.xml').getroot()
name = manifest.findtext('name')
maintainer = manifest.find('maintainer')

setup(
    name=name,
    version=manifest.findtext('version'),
    description=manifest.findtext('description'),
    maintainer=maintainer.text,
    maintainer_email=maintainer.get('email'),
    license=manifest.findtext('license'),
    python_requires='>=3.12',
    packages=find_packages(include=['svdm_core', 'svdm_core.*', 'svdm_ros', 'svdm_ros.*']),
    package_data={'svdm_core': ['*/templates/*.jinja'], 'svdm_ros': ['tuner/*.css']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{name}']),
        (f'share/{name}', ['package.xml']),
        (f'share/{name}/config', sorted(glob('config/*.*'))),
        (f'share/{name}/launch', sorted(glob('launch/*.launch.py'))),
    ],
    install_requires=['setuptools'],
    extras_require={
        'test': ['pytest'],
        'cli': ['rich', 'jinja2', 'scikit-image', 'matplotlib'],
        'bags': ['rosbags>=0.11.9,<0.12', 'rich'],
        'cluster': ['rosbags>=0.11.9,<0.12', 'rich', 'dask', 'distributed'],
        'tune': ['optuna', 'rich', 'jinja2', 'matplotlib'],
        'tuner': ['nicegui'],
    },
    zip_safe=False,
    entry_points={
        'console_scripts': [
            'disparity_node = svdm_ros.__main__:main',
            'process_bag = svdm_ros.bags.process_bag:main',
            'play_bag = svdm_ros.bags.play_bag:main',
            'images_to_bag = svdm_ros.bags.images_to_bag:main',
            'tuner = svdm_ros.tuner.__main__:main',
            'svdm = svdm_core.__main__:main',
            'svdm_demo = svdm_ros.demo.__main__:main',
        ],
    },
)
