defmodule Starl.App do
  @moduledoc """
  An application for a team of robots, in Elixir: the callbacks of `:starl_app`, which see.

      defmodule Line do
        use Starl.App, blocks: [:starl_election]

        @impl true
        def init(_robot, _options), do: :elect

        @impl true
        def step(robot, :elect) do
          case :starl_election.elect(robot, :first) do
            {:ok, leader} -> {:done, leader}
            {:error, _} -> {:continue, :elect}
          end
        end
      end
  """

  defmacro __using__(options) do
    quote do
      @behaviour :starl_app

      @impl true
      def blocks, do: unquote(Keyword.get(options, :blocks, []))

      @impl true
      def options, do: []

      defoverridable blocks: 0, options: 0
    end
  end
end
