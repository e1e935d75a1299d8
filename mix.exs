# StarL as a dependency of a mix project, by one line: {:starl, git: URL, tag: VERSION}.
# Neither rebar3 nor Hex is needed: mix compiles the applications in apps/ in their order.
defmodule Starl.MixProject do
  use Mix.Project

  {:ok, [{:application, _, props}]} =
    :file.consult(String.to_charlist(Path.join(__DIR__, "src/starl.app.src")))

  @props props

  def project do
    [app: :starl, version: to_string(@props[:vsn]), language: :erlang, deps: deps()]
  end

  def application do
    # Starl.App is written in Elixir.
    @props
    |> Keyword.take([:applications, :description, :env, :registered])
    |> Keyword.update!(:applications, &(&1 ++ [:elixir]))
  end

  defp deps do
    for app <- @props[:applications],
        File.dir?(Path.join(__DIR__, "apps/#{app}")),
        do: {app, path: "apps/#{app}"}
  end
end
