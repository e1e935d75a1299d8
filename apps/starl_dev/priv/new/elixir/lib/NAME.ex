defmodule @MODULE@ do
  @moduledoc """
  Each robot drives a square, and tells the next robot of the team when it is round. It is done when
  it is round and has heard of the robot before it.
  """
  use Starl.App

  @impl true
  def options, do: [{:side, {:integer, 100, 1500}, 500, ~c"the side of the square, mm"}]

  @impl true
  def init(robot, %{side: side}) do
    :starl.listen(robot, :round)
    {:drive, corners(:starl.position(robot), side)}
  end

  @impl true
  def step(robot, {:drive, [corner | corners]}) do
    case :starl.go_to(robot, corner) do
      :ok ->
        {:continue, {:drive, corners}}

      {:error, _} ->
        :starl.sleep(robot, 500)
        {:continue, {:drive, [corner | corners]}}
    end
  end

  def step(robot, {:drive, []}) do
    case :starl.send(robot, next(robot), :round, %{}) do
      :ok -> {:continue, :hear}
      {:error, _} -> {:continue, {:drive, []}}
    end
  end

  def step(robot, :hear) do
    case :starl.await(robot, :round, 60_000) do
      {:ok, from, %{}} -> {:done, {:heard, from}}
      :timeout -> {:done, :heard_nothing}
    end
  end

  defp corners({:ok, {x, y, _heading}}, side) do
    [{x + side, y}, {x + side, y + side}, {x, y + side}, {x, y}]
  end

  defp corners({:error, _}, side), do: corners({:ok, {side, side, 0}}, side)

  defp next(robot) do
    team = :starl.participants(robot)
    Enum.find(team, hd(team), &(&1 > :starl.id(robot)))
  end
end
