"""Files for people with ros2: parameters that the nodes take, launch files that can be loaded."""

import ast
from pathlib import Path

import pytest
import yaml
from rclpy.context import Context
from rclpy.node import Node

from rpms_ros.nodes.identifier_parameters import IdentifierParameters
from rpms_ros.nodes.parameters import NodeParameters
from rpms_ros.nodes.parameters import declare_parameters
from rpms_ros.nodes.parameters import descriptions
from rpms_ros.nodes.plant_parameters import PlantParameters
from rpms_ros.nodes.recorder import RecorderParameters

ROOT = Path(__file__).resolve().parents[2]
NODES: dict[str, type[NodeParameters]] = {
    'identifier': IdentifierParameters,
    'plant_simulator': PlantParameters,
    'recorder': RecorderParameters,
}


@pytest.mark.parametrize('name', NODES)
@pytest.mark.parametrize(('namespace', 'renamed'), [('', ''), ('/left_leg', 'quadriceps')])
def test_a_parameter_file_holds_every_parameter_at_its_default(
    context: Context, capfd: pytest.CaptureFixture[str], name: str, namespace: str, renamed: str
) -> None:
    path = ROOT / 'config' / f'{name}.yaml'
    (parameters,) = yaml.safe_load(path.read_text()).values()
    settings = NODES[name]
    assert list(parameters['ros__parameters']) == list(descriptions(settings))
    node = Node(
        renamed or name,
        namespace=namespace,
        context=context,
        cli_args=['--ros-args', '--params-file', str(path)],
        use_global_arguments=False,
    )
    # rclpy cannot tell whether a value was given: a spoiled one must be noticed
    assert set(descriptions(settings)) <= set(node._parameter_overrides)
    assert declare_parameters(node, settings) == settings()
    assert 'unknown' not in capfd.readouterr().err


@pytest.mark.parametrize(
    'path', sorted((ROOT / 'launch').glob('*.py')), ids=lambda path: path.name
)
def test_a_launch_file_compiles_and_describes_a_launch(path: Path) -> None:
    tree = ast.parse(path.read_text())
    compile(tree, str(path), 'exec')
    functions = {part.name: part for part in tree.body if isinstance(part, ast.FunctionDef)}
    assert not functions['generate_launch_description'].args.args
    assert path.name.endswith('.launch.py')


def test_launch_files_name_nodes_and_parameter_files_that_exist() -> None:
    text = (ROOT / 'launch' / 'simulation.launch.py').read_text()
    setup = (ROOT / 'setup.py').read_text()
    for name in (*NODES, 'stimulator_driver'):
        assert f"'{name}'" in text
        assert f"'{name} = rpms_ros.nodes.executables:{name}'" in setup
        assert (ROOT / 'config' / f'{name}.yaml').is_file()
